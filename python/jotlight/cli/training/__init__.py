"""Steps of ``train`` and ``fine-tune``.

In reading order: ``training_options`` (their options), ``training_data`` (the images and the
sensor), ``learners`` (the function that trains a network), and ``training_run`` (its checkpoint,
its progress, and its files).
"""
