"""Detection measured: policies and environments go in, average precision by the protocols of the field comes out.

An episode becomes flat arrays of boxes (`episode.py`, `perceived.py`), these become rankings (`ranking.py`,
`protocols.py`), and these the rows of a table. Start at `measure_detection` in `detect.py`.
"""
