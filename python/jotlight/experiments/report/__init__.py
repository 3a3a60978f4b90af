"""From the results of experiments or benchmarks to pages and figures.

- `changes`: which methods changed after a measurement
- `content`: claims, tables, curves, and images, independent of how they are shown
- `contrast`: colors that are visible on the light and on the dark ground of a page
- `curves`: curves as SVG, on white
- `markdown`: a report as a page of Markdown
- `page`: a report as one HTML page (page.html, page.css, page.js)
- `overview`: the section that compares the quality and the time of all methods
- `report`: the report of the experiments, and the files that show it
"""
