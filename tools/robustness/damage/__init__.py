"""Damage that captures and processes suffer: kills, full disks, and flipped bits."""
