"""The section of the page that compares the deep networks in jotlight and in other programs."""

from collections.abc import Sequence
from typing import Any

from jotlight.experiments.report.content import Column, Section, Table, Value
from suite.derived import Task, ratio
from suite.tables import format_significant, thread_words
from suite.tasks.deep_rivals import PROGRAMS, RELU

TASK_TITLE = "Network, "

TEXT = (
    "Each program runs the same networks, from the same bits in memory to an estimate, in its best "
    "configuration. PyTorch compiles with Inductor and frozen parameters. Inductor by itself "
    "stores the planes for filters with the channels of a pixel side by side, as the rows with "
    "channels-last request it everywhere. ONNX Runtime and OpenVINO run the exported ONNX models. "
    "NumPy counts the ones for all programs but jotlight. In bfloat16, jotlight uses AMX if the "
    "processor has it, and emulates the rounding otherwise. With floats of 32 bits, results must "
    f"agree with jotlight's within the tolerance. “{RELU}” is untrained and computes another "
    "function: filters of 3 × 3 taps at half the resolution, with nearly the same number of "
    "multiply-adds and without splines. It shows what a competitor could reach. "
    "To measure this section alone, without changing this page:"
)


def competitor_sections(run: dict[str, Any], program: str) -> list[Section]:
    """Return the section about the deep networks, or none if they were not measured.

    `program` is the command that runs the benchmark.
    """
    tasks = [task for task in run["tasks"] if task.get("multiply_adds")]
    if not tasks:
        return []
    command = f"{program} --only {' '.join(task['name'] for task in tasks)}"
    tables = [ratio_table(tasks, run["threads"]), cost_table(tasks)]
    if any(task["rounded_differences"] for task in tasks):
        tables.insert(1, precision_table(tasks))
    return [Section("competitors", "Deep networks in other programs", TEXT, command, tables=tables)]


def ratio_table(tasks: Sequence[Task], threads: Sequence[int]) -> Table:
    """Return the time of each program as a multiple of jotlight's."""
    pairs = [(task, number) for task in tasks for number in threads]
    titles = [f"{size(task)}, {thread_words(number)}" for task, number in pairs]
    rows: list[list[Value]] = []
    for name in PROGRAMS:
        if any(name in task["seconds"]["1"] for task in tasks):
            found = [
                ratio(task, name, number) if name in task["seconds"][str(number)] else None
                for task, number in pairs
            ]
            rows.append([name, *found])
    columns = [Column("program"), *(Column(title, format_significant) for title in titles)]
    return Table("Time as a multiple of jotlight's: below 1, the program is faster", columns, rows)


def precision_table(tasks: Sequence[Task]) -> Table:
    """Return what the precision of bfloat16 costs, for the programs that use it."""
    columns = [Column("program")]
    for task in tasks:
        columns += [
            Column(f"{size(task)}, largest difference", format_significant),
            Column(f"{size(task)}, PSNR in dB", ".2f"),
            Column(f"{size(task)}, loss in dB", ".3f"),
        ]
    rounded = {name for task in tasks for name in task["rounded_differences"]}
    names = [name for name in PROGRAMS if name in rounded]
    rows: list[list[Value]] = []
    for name in ("jotlight", *names):
        row: list[Value] = [name]
        for task in tasks:
            psnr = task["psnr"].get(name)
            loss = None if psnr is None else task["psnr"]["jotlight"] - psnr
            row += [task["rounded_differences"].get(name), psnr, loss]
        rows.append(row)
    title = (
        "bfloat16: the largest difference from jotlight, relative to the largest intensity, and "
        "the PSNR of the photograph `camera`"
    )
    return Table(title, columns, rows)


def cost_table(tasks: Sequence[Task]) -> Table:
    """Return who does how many multiply-adds."""
    names = list(tasks[0]["multiply_adds"])
    columns = [Column("network"), *(Column(name, format_significant) for name in names)]
    rows = [[size(task), *(task["multiply_adds"][name] for name in names)] for task in tasks]
    return Table("Multiply-adds of the filters per pixel", columns, rows)


def size(task: Task) -> str:
    """Return the size of a network."""
    return task["title"].removeprefix(TASK_TITLE)
