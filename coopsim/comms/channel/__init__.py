"""The channel: an event queue between agents, and the models that decide loss, delay, bandwidth and clocks.

Input is `ChannelConfig` and the messages of each moment; output is the messages that are due. Start with `channel.py`.
"""
