"""The description in an archive: one that violates the schema, is too large, or means no plant."""

import re

import fmpy
import pytest

from nrs_cosim.plant_fmu.archives import model_description
from nrs_cosim.plant_fmu.archives.archive import open_archive
from nrs_cosim.plant_fmu.archives.variables import find_quantity
from tests.plant_fmu.rewritten_fmus import rewritten
from tests.plant_fmu.test_archive import refused


def test_a_description_that_violates_the_schema_still_works(tmp_path):
    def invalid(text: str) -> str:
        text = text.replace("<ModelStructure>", "<ModelStructure><Strange/>")
        return text.replace(' modelName="two_link_arm"', ' unheardOf="1"')

    path = rewritten(tmp_path / "arm.fmu", 2, invalid)
    with pytest.raises(fmpy.model_description.ValidationError):
        fmpy.read_model_description(path)
    assert find_quantity(open_archive(path), "q").size == 2


def test_a_description_that_is_too_large_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(model_description, "MOST_BYTES", 1 << 10)
    assert refused(rewritten(tmp_path / "arm.fmu", 3, str)).startswith(
        "its modelDescription.xml is "
    )


@pytest.mark.parametrize(
    ("fmi", "edit", "message"),
    [
        (2, lambda text: text.replace("</fmiModel", "<fmiModel"), r"line \d+, column \d+"),
        (2, lambda text: text.replace("<ModelVariables>", "<Model Variables"), r"line \d+"),
        (2, lambda _: "", "Document is empty, line 1"),
        (
            2,
            lambda text: text.replace('fmiVersion="2.0"', 'fmiVersion="4.0"'),
            "is of FMI 4.0; FMI 2.0 and 3.0 can be run, and 1.0 be read",
        ),
        (2, lambda text: text.replace('fmiVersion="2.0"', ""), "is of FMI without version"),
        (2, lambda text: text.replace("fmiModelDescription", "html"), "is a html, expected fmiMod"),
        (
            2,
            lambda text: text.replace("<Real", "<Float64"),
            r"line \d+: variable 'time' has no type",
        ),
        (3, lambda text: text.replace("Float64", "Real"), r"line \d+: variable 'time' has no type"),
        (
            3,
            lambda text: text.replace('valueReference="1"', 'valueReference="-1"'),
            r"variable 'tau' has the value reference '-1'",
        ),
        (
            3,
            lambda text: text.replace('valueReference="1"', 'valueReference="4294967296"'),
            r"variable 'tau' has the value reference '4294967296'",
        ),
        (
            2,
            lambda text: text.replace('causality="input"', 'causality="inptu"', 1),
            r"\(line \d+, column 0\): .*'inptu'",
        ),
        (
            2,
            lambda text: text.replace('causality="input"', 'causality="parameter"', 1),
            r'Variable ".*" \(line \d+\) has an illegal combination',
        ),
        (
            3,
            lambda text: text.replace('<Output valueReference="', '<Output valueReference="80', 1),
            r"line \d+: valueReference of Output names the value reference 80\d+, but there",
        ),
        (
            3,
            lambda text: text.replace(' derivative="', ' derivative="9', 1),
            r"line \d+: derivative of Float64 names the value reference 9\d+, but there is none",
        ),
        (
            2,
            lambda text: text.replace('<Unknown index="', '<Unknown index="80', 1),
            r"line \d+: index of Unknown names variable no. 80\d+, but there is none",
        ),
        (
            2,
            lambda text: re.sub("<ModelVariables>.*</ModelVariables>", "", text, flags=re.DOTALL),
            "ModelVariables",
        ),
    ],
)
def test_an_unusable_description_is_refused_with_the_line(tmp_path, fmi, edit, message):
    result = refused(rewritten(tmp_path / "arm.fmu", fmi, edit))
    assert re.match(
        f"its modelDescription.xml (cannot be used|is not valid XML): .*{message}", result
    )


def test_entities_are_not_expanded_and_nothing_is_fetched(tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("secret")
    for entity in (f'SYSTEM "{secret.as_uri()}"', '"&a;&a;"', '"two"'):
        doctype = f'<!DOCTYPE x [<!ENTITY a "{"a" * 100}"><!ENTITY b {entity}>]>'

        def expanding(text: str, doctype: str = doctype) -> str:
            text = text.replace("<fmiModel", f"{doctype}<fmiModel", 1)
            return text.replace('modelName="', 'modelName="&b;', 1)

        result = refused(rewritten(tmp_path / "arm.fmu", 3, expanding))
        assert "secret" not in result
        assert result.startswith("its modelDescription.xml ")
