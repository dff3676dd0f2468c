"""A text that is no TOML is told with line, column, the character, and what to write."""

import pytest

from tests.command import nrs

LINES = ['name = "dcea1"  # “quotes” − 0,9 may stand here', "alpha = 0.9", "beta = 1.1"]
BEGIN = "[algorithm]\n"


@pytest.mark.parametrize(
    ("given", "place", "said"),
    [
        ("alpha = 0,9", (3, 9), "got 0,9; write 0.9"),
        ("alpha =-1,25 # half", (3, 8), "got -1,25; write -1.25"),
        ("alpha = −0.9", (3, 9), "got '−' (U+2212 MINUS SIGN); write -"),
        ("alpha = –0.9", (3, 9), "got '–' (U+2013 EN DASH); write -"),
        ("alpha\xa0= 0.9", (3, 6), r"got '\xa0' (U+00A0 NO-BREAK SPACE); write a blank"),
        ("alpha ＝ 0.9", (3, 7), "got '＝' (U+FF1D FULLWIDTH EQUALS SIGN); write ="),
        ("alpha = ٣", (3, 9), "(U+0663 ARABIC-INDIC DIGIT THREE); leave it out, or put "),
        ("x = “a”", (3, 5), "got '“' (U+201C LEFT DOUBLE QUOTATION MARK); write \""),
        ('x = ["−", ‘b’]', (3, 11), "got '‘' (U+2018 LEFT SINGLE QUOTATION MARK); write '"),
        ("α = 0.9", (3, 1), "got 'α' (U+03B1 GREEK SMALL LETTER ALPHA); leave it out, or put "),
    ],
)
def test_a_character_that_toml_forbids_is_named_with_its_place(tmp_path, given, place, said):
    file = tmp_path / "a.toml"
    file.write_text(BEGIN + "\n".join([LINES[0], given, *LINES[2:]]) + "\n", "utf-8")
    done = nrs("check", file)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"a.toml: line {place[0]}, column {place[1]}: " in done.stderr
    assert said in done.stderr


def test_other_toml_errors_are_in_the_parsers_words(tmp_path):
    file = tmp_path / "a.toml"
    file.write_text(BEGIN + "alpha = 0.9 x\n", "utf-8")
    done = nrs("check", file)
    assert done.returncode == 2
    assert "a.toml: not valid TOML: Expected newline" in done.stderr
    assert "(at line 2, column 13)" in done.stderr


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (
            b"[run]\n# caf\xe9\n",
            "line 2, column 6 is the byte 0xe9, \xe9 in Latin-1; save the file",
        ),
        (b"# \xc3\xa9 \xe4", "line 1, column 5 is the byte 0xe4, \xe4 in Latin-1; save the file"),
        (b"\xff\xfe[\0", "line 1, column 1 is the byte 0xff"),
        (b"[run]\n\x93a\x94", "line 2, column 1 is the byte 0x93; save the file as UTF-8"),
    ],
)
def test_text_that_is_not_utf8_is_refused_with_the_place_of_the_byte(tmp_path, data, said):
    file = tmp_path / "a.toml"
    file.write_bytes(data)
    done = nrs("check", file)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"a.toml: cannot be read: it is no text in UTF-8: {said}" in done.stderr


def test_a_number_in_place_of_a_table_is_named():
    done = nrs("check", "scenarios/paper_first_order.toml", "--set", "plant.parameters=3")
    assert done.returncode == 2
    assert "plant.parameters: expected a table, got 3" in done.stderr
