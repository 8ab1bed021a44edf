"""The loop of a training: steps, checkpoints, logs, and looks at held-out places."""
