"""The radio: reception, interference, obstruction."""
