"""The parts of `python benchmarks/speed/run.py`.

case, timing, threads, probes  checking and timing the programs of one task
tasks                          the tasks, one file each
scaling, one_size, latency     growth with size, and the time of commands
machine                        facts about the machine and the software
derived, comparisons           quantities that follow from the times
competitors                    the section about deep networks in other programs
tables, curves, page, record   the page and its files
"""
