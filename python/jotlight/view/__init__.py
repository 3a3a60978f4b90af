"""The viewer: a local server and one page that shows a capture while the user moves a slider.

The modules of the server, :mod:`jotlight.view.app` and :mod:`jotlight.view.serving`, need the extra
``view``. All other modules need nothing but jotlight.
"""
