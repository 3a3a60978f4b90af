"""Facts and advice as lines of text.

- ``capture_facts``, ``network_facts``, ``origins``: what ``info`` shows of captures, of networks,
  and of results.
- ``simulated_origin``: the origin of results that are made of simulated bits.
- ``advice``: where a network does not fit a capture, or where the scene moves.
"""
