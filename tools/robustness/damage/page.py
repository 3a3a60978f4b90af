PAGE_FILE="robustness.md"
def build_report(r): return ""
