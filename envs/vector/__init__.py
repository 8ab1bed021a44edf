"""Many environments at once: `coopsim.vector` makes a vector, by name and number of environments.

Actions of all environments come in; lists of dicts by agent, or gymnasium's arrays, go out. Start reading in `make`,
then `vectors` (the classes that users hold), `stepper` (autoreset, lost environments), `episodes` (seeds), `pools` and
`worker` (processes), `environments` (the far end: the environments of one worker) and `shared_blocks` (the memory
between the two).
"""
