"""Reports of a benchmark: results go in; an HTML page, Markdown, CSV and plots come out.

Start at `publish.py`, which writes them all; `bench_report.py` is the page, `template/` its HTML and scripts.
"""
