"""The loop of a training: steps of the optimizer, with checkpoints, log and validation between them.

A task and the order of its samples come in; trained weights, a log, curves and a card go out. Start reading at
`train_loop`.
"""
