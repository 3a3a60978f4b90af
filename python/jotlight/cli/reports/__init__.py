"""Facts and advice as lines of text.

- ``capture_facts``, ``network_facts``, ``origins``: what ``info`` shows of captures, of networks,
  and of results.
- ``advice``: where a network does not fit a capture, or where the scene moves.
"""
