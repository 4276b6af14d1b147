"""The page of `make evidence`: figures as they were given, and what failed as that."""

from __future__ import annotations

from bench.evidence import Measured, Measurement, measured, page, rendered

SAID = Measurement("Some figures", "-c print('{}')", "-c print(1)", "What they are.")


def test_a_list_of_objects_is_a_table_and_an_object_a_list() -> None:
    found = rendered([{"load": "none", "heard_p99_ms": 1.23456}, {"load": "all", "lost": 2}])
    assert found == [
        "| load | heard p99 ms | lost |",
        "|---|---|---|",
        "| none | 1.235 | - |",
        "| all | - | 2 |",
    ]
    assert rendered({"frame_ms": {"p50": 1.5, "max": 2}, "mb": [60.0, 61.5], "is_met": True}) == [
        "- frame ms: p50 1.5, max 2",
        "- mb: 60, 61.5",
        "- is met: yes",
    ]


def test_what_failed_is_on_the_page_as_that() -> None:
    failed = Measured(SAID, "run.py", 1, 2.0, None, "no engine within 30 s")
    text = page([failed], is_short=True)
    assert "exit status 1: NOT met" in text
    assert "no engine within 30 s" in text
    assert "make evidence ARGS=--short" in text


def test_a_command_is_run_and_its_last_line_is_taken() -> None:
    asked = Measurement("One", "-c pass", "-c print(1);print(dict(a=1))", "")
    assert measured(asked, is_short=False).figures is None
    found = measured(asked, is_short=True)
    assert (found.status, found.figures) == (0, None)
    assert found.said.endswith("{'a': 1}")
    as_json = Measurement("One", "", "-c print('{\"a\":1}')", "")
    assert measured(as_json, is_short=True).figures == {"a": 1}


def test_the_page_names_machine_date_and_version() -> None:
    text = page([Measured(SAID, "run.py", 0, 2.0, {"a": 1}, "")], is_short=False)
    for what in ("- date: 20", "- version: ", "- machine: ", "cores", "- a: 1", "bounds were met"):
        assert what in text
