"""Networks in files.

``network_files`` is the file format of jotlight. ``onnx_export`` writes ONNX models, with
``onnx_graph``.
"""
