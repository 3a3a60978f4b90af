"""Write the page and its figures anew from the JSON of a run.

python benchmarks/speed/remake.py docs/results
"""

import sys
from pathlib import Path

from suite.record import read, write_page

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    print(write_page(read(folder), folder))
