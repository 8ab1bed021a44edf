"""Policies in processes of their own: observations go in, actions and messages come out as data that name no code.

Start at `Isolation` in `isolation.py`, our side; `guest.py` is the program of the other process.
"""
