"""How an image was made.

``info`` says how it was estimated, ``weights`` names the files of the networks behind it, and
``records`` states what it was made of.
"""
