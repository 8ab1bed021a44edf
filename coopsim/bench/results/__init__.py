"""Results of a benchmark: results of cells go in; arrays, rankings and tests of differences come out.

Start at `ResultTable` in `result_table.py`; the mathematics is in `statistics.py`.
"""
