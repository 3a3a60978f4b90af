"""Runs over many captures, or over the windows of a capture.

``many`` runs the jobs of ``capture_jobs``, one for each capture. ``run_notes`` state what a run
assumes.
"""
