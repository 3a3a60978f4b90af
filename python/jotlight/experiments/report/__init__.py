"""From the results of experiments or benchmarks to pages and figures.

- `changes`: which methods changed after a measurement
- `content`: claims, tables, curves, and images, independent of how they are shown
- `curves`: curves as SVG
- `markdown`: a report as a page of Markdown
- `page`: a report as one HTML page (page.html, page.css, page.js)
- `overview`: the section that compares the quality and the time of all methods
- `report`: the report of the experiments, and the files that show it
"""
