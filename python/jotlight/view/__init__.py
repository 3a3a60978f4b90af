"""The viewer: a local server and one page that shows a capture while the user moves a slider.

In reading order:

- ``viewed``, ``state``: a capture as it is viewed, and the controls of the page. ``counted``: what
  its counts are called, such as ones or sums of readings.
- ``pipeline``: from a request to images, by ``running_counts``, ``estimate``,
  ``overlays``, and ``display``.
- ``session``, ``workshop``, ``messages``, ``notes``: the connection of a page, and what connections
  share. ``timeline``, ``facts``, ``recipe``, ``saving``: what else the page shows and saves.
- ``app``, ``serving``, ``access``: the web application, its server, and who may use it.
- ``live``: captures that grow while they are viewed. ``extra``: the packages of the server.

The modules of the server, :mod:`jotlight.view.app` and :mod:`jotlight.view.serving`, need the extra
``view``. All other modules need nothing but jotlight.
"""
