"""Many environments at once: `coopsim.vector`, with worker processes over shared memory, or Ray.

| file | what is in it |
|---|---|
| make | `vector`, which users call |
| multi_agent, single_agent | what it returns: lists of dicts by agent, or gymnasium's arrays |
| stepper | seeds, autoreset, and what happens to lost environments |
| crew, hold | which worker has which environments; workers that die; Ctrl-C |
| in_process, process (with serve), on_ray | the three kinds of workers |
| group | the environments of one worker |
| line, contents, arena | messages between two processes: headers by pipes, contents by shared memory |
"""
