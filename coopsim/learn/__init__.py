"""Training of cooperative networks on what the simulator makes: samples, targets, recipes, checkpoints, evaluation."""
