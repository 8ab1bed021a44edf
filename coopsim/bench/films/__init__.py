"""Films of runs from above: a benchmark's runs keep them, in files beside their results, and reports read them.

Start at `film.py`: `Filming` records a `Film`. `film_file.py` makes files of films, `filmed_job.py` jobs that keep
them; `choice.py`, `moments.py`, `lie_pairs.py` and `crash_pairs.py` choose what a report shows.
"""
