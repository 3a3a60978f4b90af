"""Running experiments in parts, and the tables that keep their rows."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jotlight.experiments import runner, tables
from jotlight.experiments.experiment import Data, Experiment, Part, PartResult, Results
from jotlight.experiments.report.content import Section
from jotlight.temporary_names import reserve_temporary


class Counting:
    """An experiment of three parts that counts how often each is run."""

    def __init__(self, fails_at=None):
        self.runs = []
        self.fails_at = fails_at
        self.experiment = Experiment(
            *("counting", "Counting", {"size": 3}, {"size": 2}, self.parts),
            lambda _: Section(*"abcd"),
            compares_methods=True,
        )

    def parts(self, lab):
        def make(number):
            def run(update):
                update(0.5)
                if number == self.fails_at:
                    raise KeyboardInterrupt
                self.runs.append(number)
                row = {"number": number, "third": number / 3, "word": "a, b", "nothing": None}
                return PartResult([row], {f"{number}.png": bytes([number])})

            return run

        return [Part(f"part{number}", 1.0, make(number)) for number in range(lab.settings["size"])]

    def run(self, folder, *, quick=False, restart=False, own=()):
        """Do what the command does, without its messages."""
        options = {"quick": quick, "restart": restart, "data": Data(), "threads": None, "own": own}
        lab = runner.prepare(self.experiment, folder, **options)
        for part in self.experiment.parts(lab):
            if not folder.part_file(self.experiment, part).exists():
                runner.run_part(self.experiment, part, folder, lambda share: None)
        collected = runner.collect(self.experiment, lab, folder)
        runner.finish(lab)
        return collected


@pytest.fixture
def folder(tmp_path):
    made = runner.Folder(tmp_path / "out")
    made.results.mkdir(parents=True)
    return made


def test_the_next_run_removes_what_a_killed_run_left_beside_finished_parts(folder):
    counting = Counting()
    counting.run(folder)
    parts = folder.parts("counting")
    before = sorted(parts.iterdir())
    for path in before:
        with reserve_temporary(path) as temporary:
            name = temporary.with_name(f"{temporary.name}.lock")
        name.touch()
    counting.run(folder)
    assert sorted(parts.iterdir()) == before


def test_a_finished_part_does_not_run_again(folder):
    counting = Counting()
    first = counting.run(folder)
    assert counting.run(folder) == first
    assert counting.runs == [0, 1, 2]
    assert [row["number"] for row in first[0]] == [0, 1, 2]
    assert (folder.parts("counting") / "2.png").read_bytes() == b"\2"


def test_an_interrupted_run_continues_where_it_stopped(folder):
    stopped = Counting(fails_at=1)
    with pytest.raises(KeyboardInterrupt):
        stopped.run(folder)
    continued = Counting()
    rows, _ = continued.run(folder)
    assert (stopped.runs, continued.runs) == ([0], [1, 2])
    whole = Counting()
    assert rows == whole.run(runner.Folder(folder.path / "another"))[0]


def test_a_finished_run_with_a_function_of_the_caller_starts_anew(folder):
    # Such functions may read files that have changed, such as the weights of a network.
    counting = Counting()
    counting.run(folder, own=["builtins:sum"])
    counting.run(folder, own=["builtins:sum"])
    assert counting.runs == [0, 1, 2, 0, 1, 2]


def test_an_interrupted_run_with_a_function_of_the_caller_continues(folder):
    stopped, continued = Counting(fails_at=1), Counting()
    with pytest.raises(KeyboardInterrupt):
        stopped.run(folder, own=["builtins:sum"])
    continued.run(folder, own=["builtins:sum"])
    assert continued.runs == [1, 2]


def test_restart_runs_every_part_again(folder):
    counting = Counting()
    counting.run(folder)
    counting.run(folder, restart=True)
    assert counting.runs == [0, 1, 2, 0, 1, 2]


def test_other_settings_are_rejected_and_the_results_stay(folder):
    counting = Counting()
    before = counting.run(folder)
    with pytest.raises(ValueError, match=r"other settings \(quick, size\).*--output.*--restart"):
        counting.run(folder, quick=True)
    assert counting.run(folder) == before
    rows, _ = counting.run(folder, quick=True, restart=True)
    assert len(rows) == 2


def test_the_error_names_a_damaged_part(folder):
    counting = Counting()
    counting.run(folder)
    path = folder.parts("counting") / "part1.json"
    path.write_text('{"rows": [')
    with pytest.raises(ValueError, match=r"part1\.json: damaged.*--restart"):
        counting.run(folder)


def test_the_facts_describe_the_run(folder):
    _, facts = Counting().run(folder)
    settings = json.loads(facts["settings"])
    assert settings["size"] == 3
    assert settings["quick"] is False
    assert settings["jotlight"]
    assert "Python" in facts["machine"]
    assert float(facts["seconds"]) >= 0


def test_a_table_survives_writing_and_reading(folder):
    rows, facts = Counting().run(folder)
    tables.write_table(folder.results / "counting.csv", rows)
    tables.write_facts(folder.results / "run.csv", {"counting": facts})
    results = tables.read_results(folder.results, lambda _: None)["counting"]
    assert list(results.rows) == rows
    assert results.settings == json.loads(facts["settings"])
    assert results.column("third", number=1) == pytest.approx([1 / 3], rel=1e-5)


def test_writing_facts_keeps_those_of_other_experiments(tmp_path):
    path = tmp_path / "run.csv"
    tables.write_facts(path, {"a": {"seconds": "1"}, "b": {"seconds": "2"}})
    tables.write_facts(path, {"b": {"seconds": "3", "date": "today"}})
    assert tables.read_facts(path) == {
        "a": {"seconds": "1"},
        "b": {"seconds": "3", "date": "today"},
    }


words = st.text(st.characters(blacklist_categories=("Cs", "Cc")), min_size=1, max_size=8).filter(
    lambda word: not isinstance(tables.parse_cell("a", word), int | float)
)
values = st.one_of(
    st.none(), st.integers(-(10**9), 10**9), st.floats(allow_nan=False, allow_infinity=False), words
)


@pytest.mark.slow
@given(st.lists(st.fixed_dictionaries({"a": values, "b, ü": values}), min_size=1, max_size=5))
def test_any_table_survives_writing_and_reading(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("tables") / "table.csv"
    tables.write_table(path, rows)
    assert tables.read_table(path) == rows


def test_rows_are_selected_by_their_values():
    rows = [{"k": k, "name": name, "psnr": k + 0.5} for k in (4, 9) for name in "ab"]
    results = Results({}, rows)
    assert results.unique("k") == [4, 9]
    assert results.column("psnr", name="a").tolist() == [4.5, 9.5]
    assert results.rows_where(k=9, name="b") == [rows[3]]
