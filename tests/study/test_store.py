"""A study's folder is whole whatever was torn, and rows in parts are the rows of the journal."""

import json
import resource

import pytest

from nrs_cosim.bus.errors import InputError, RunError
from nrs_cosim.orchestrator.study.rows import StudyRow, table_digest
from nrs_cosim.orchestrator.study.store import StudyStore


def made(number, status="converged"):
    """Return a row."""
    return StudyRow(
        key=f"{number:064x}", point='{"algorithm.alpha":0.5}', scenario="paper", seed=number,
        status=status, digest="d" * 64, ticks=number, position_estimate=number / 7,
        measured_rate=None if number % 2 else 0.1, cpu_seconds=0.2,
    )  # fmt: skip


def test_rows_are_there_after_each_is_put(tmp_path):
    store = StudyStore(tmp_path)
    with store:
        for number in range(5):
            store.put(made(number))
            assert list(StudyStore(tmp_path).rows()) == [made(n) for n in range(number + 1)]


def test_a_line_torn_at_any_byte_is_cut_and_no_row_before_it_is_lost(tmp_path):
    with StudyStore(tmp_path) as store:
        store.put(made(0))
        before = store.journal.stat().st_size
        store.put(made(1))
    whole = store.journal.read_bytes()
    for end in range(before, len(whole)):
        store.journal.write_bytes(whole[:end])
        assert list(StudyStore(tmp_path).rows()) == [made(0)]
    with StudyStore(tmp_path) as again:
        again.put(made(2))
    assert list(again.rows()) == [made(0), made(2)]


def test_the_later_row_of_a_key_holds(tmp_path):
    with StudyStore(tmp_path) as store:
        store.put(made(1, "crashed"))
        store.put(made(2))
        store.put(made(1))
    assert store.statuses() == {made(1).key: "converged", made(2).key: "converged"}


def test_a_part_has_the_same_rows_as_the_journal_that_it_was(tmp_path):
    with StudyStore(tmp_path) as store:
        for number in range(20):
            store.put(made(number))
        before = [*store.rows()]
        torn = store.journal.read_bytes()
        store.roll(least=20)
        assert store.journal.stat().st_size == 0
        assert [path.name for path in store.parts] == ["rows-00001.parquet"]
        assert [*store.rows()] == before
        store.put(made(20))
        store.journal.write_bytes(torn + store.journal.read_bytes())
    assert sorted(row.seed for row in store.rows()) == list(range(21))
    assert table_digest(store.rows()) == table_digest([*before, made(20)])


def test_a_short_journal_is_no_part(tmp_path):
    with StudyStore(tmp_path) as store:
        store.put(made(1))
        store.roll()
    assert store.parts == []


def test_a_folder_without_a_study_is_refused(tmp_path):
    (tmp_path / "file.toml").touch()
    for folder in (tmp_path, tmp_path / "none", tmp_path / "file.toml"):
        with pytest.raises(InputError, match=r"is no study: it has no study\.json"):
            StudyStore(folder).definition()
    (tmp_path / "study.json").write_text(json.dumps({"format": 99}), "utf-8")
    with pytest.raises(InputError, match="of no format that this version knows"):
        StudyStore(tmp_path).definition()


@pytest.mark.parametrize("line", ["[1]", "null", '{"key": 5}', "{", '{"key": "a", "seed": 1}'])
def test_a_line_that_is_no_row_is_told_with_its_number(tmp_path, line):
    with StudyStore(tmp_path) as store:
        store.put(made(1))
    store.journal.write_bytes(store.journal.read_bytes() + f"{line}\n".encode())
    with pytest.raises(InputError, match=r"journal\.jsonl: line 2 is no row"):
        store.statuses()


@pytest.mark.parametrize("damage", [{}, {"scenarios": [{}]}, {"axes": [1]}, {"axes": {}}])
def test_a_definition_that_is_damaged_is_told(tmp_path, damage):
    store = StudyStore(tmp_path)
    whole = {"scenarios": [{"name": "a", "text": "", "folder": ""}], "axes": []}
    store.define(whole)
    assert store.definition() == {"format": 1, **whole}
    store.define({**whole, **damage} if damage else {})
    with pytest.raises(InputError, match="is damaged"):
        store.definition()


def test_a_part_that_is_damaged_is_told_and_other_files_are_none(tmp_path):
    store = StudyStore(tmp_path)
    (tmp_path / "rows-mine.parquet").touch()
    assert list(store.rows()) == []
    (tmp_path / "rows-00001.parquet").write_bytes(b"junk")
    with pytest.raises(InputError, match="cannot be read"):
        store.statuses()


def test_a_full_disk_is_told_and_the_rows_before_are_kept(tmp_path):
    row, soft = made(1), resource.getrlimit(resource.RLIMIT_FSIZE)
    store = StudyStore(tmp_path)
    with store:
        store.put(row)
        resource.setrlimit(resource.RLIMIT_FSIZE, (store.journal.stat().st_size * 3 // 2, soft[1]))
        try:
            with pytest.raises(RunError, match=r"journal\.jsonl: cannot be written: File too"):
                store.put(made(2))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, soft)
    assert list(store.rows()) == [row]
    with store:
        store.put(made(3))
    assert list(store.rows()) == [row, made(3)]


def test_the_digest_of_a_table_leaves_out_the_machine_and_the_order():
    rows = [made(1), made(2)]
    other = [StudyRow.of({**made(2).as_json(), "pid": 7, "host": "b", "cpu_seconds": 9.0}), made(1)]
    assert table_digest(rows) == table_digest(other)
    assert table_digest(rows) != table_digest([made(1), made(3)])
