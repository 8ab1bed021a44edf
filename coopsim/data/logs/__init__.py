"""Logs of traffic: tracks of real road users from files of many formats. Start in `reading.py`."""
