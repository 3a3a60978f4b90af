"""Write reproduction.md and its curves anew from the tables beside them.

python -m jotlight.experiments.report docs/results
"""

import sys
from pathlib import Path

from jotlight.experiments.report.report import read_report, write_markdown

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    write_markdown(read_report(folder), folder)
