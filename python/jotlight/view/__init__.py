"""The viewer: a local server and one page that shows a capture while the user moves a slider.

In reading order:

- ``viewed``, ``state``: a capture as it is viewed, and the controls of the page. ``counted``: what
  its counts are called, such as ones or sums of readings.
- ``pipeline``: from a request to images, by ``running_counts``, ``alignment``, ``estimate``,
  ``overlays``, and ``display``.
- ``session``, ``workshop``, ``messages``, ``notes``: the connection of a page, and what connections
  share. ``timeline``, ``facts``, ``recipe``, ``saving``: what else the page shows and saves.
- ``app``, ``serving``, ``connections``, ``access``: the web application, its server, when
  connections end, and who may use it.
- ``live``: captures that grow while they are viewed. ``extra``: the packages of the server.

The modules of the server, ``app``, ``serving``, and ``connections``, need the extra ``view``. All
other modules need nothing but jotlight.
"""
