"""Results as text: Markdown, CSV and plain tables for people and for spreadsheets.

Start at `bench_text.py`; `forms.py` has how values, intervals and tables are written, everywhere.
"""
