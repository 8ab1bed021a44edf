"""How well reported tracks match the truth."""
