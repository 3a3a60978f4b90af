"""The plugin for napari: readers, a dock widget, and samples. Requires the extra ``napari``."""
