"""Files of a benchmark for papers: results go in; tables, a figure and the protocol come out.

Start at `paper_files` in `coopsim.bench.report.publish`, which writes them.
"""
