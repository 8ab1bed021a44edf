"""Instance queries: objects as vectors of features that agents decode, send, match, fuse and carry over.

In: an agent's map and other agents' instances. Out: instances with numbers. Start reading at `query_net`; `perceiver`
runs it frame after frame.
"""
