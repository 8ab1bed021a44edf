"""The radio: the probability that a message is received, by path loss, obstruction and interference.

Input is `Radio` and the antennas and obstacles of a moment (`RadioScene`); output is a probability for each link. Start
with `reception.py`.
"""
