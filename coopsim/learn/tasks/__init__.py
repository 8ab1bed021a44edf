"""Tasks: one class per kind of training, with its network, the drawing of its samples and its losses.

A recipe and a seed come in; losses of batches, values of held-out clips and files of weights go out. Start reading at
`training_task`, then `detector_task`.
"""
