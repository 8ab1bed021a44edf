"""Communication: content of agents becomes messages (uplinks), bytes (codecs) and deliveries (channel, radio).

Input is each agent's `Observation`; output is the inbox of each agent, after loss, delay and bandwidth. Start with
`uplinks/uplink.py` for the content of messages, `codecs/codec.py` for their bytes, `channel/channel.py` for their way.
"""
