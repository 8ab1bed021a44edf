"""Training of networks: a recipe (a YAML file) and a seed come in; weights, card, curves and log go out.

In the order of the data: `clips` (simulated or recorded scenes as plain arrays), `samples` cut from them, `losses` on
their targets, `tasks` (a network with its samples and losses, one per kind of training), the `loop`, and `weights`.
Start reading at `coopsim.learn.train.train`.
"""
