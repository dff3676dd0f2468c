"""A change sets the keys that it names, as TOML would, and keeps the others."""

import re
import tomllib

import pytest

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.scenario.changes import Change, with_changes
from nrs_cosim.orchestrator.scenario.file import changed
from nrs_cosim.orchestrator.scenario.tables.fmus import Pattern
from tests.scenarios import paper, toml

OTHER = {
    "plant.fmu": "own.fmu",
    "plant.parameters": {"mass": 3.0},
    "plant.variables": {"q": "theta"},
}


def nested(change):
    """Return the values of a change as a table."""
    table = {}
    for (*above, name), value in change.values.items():
        inner = table
        for part in above:
            inner = inner.setdefault(part, {})
        inner[name] = value
    return table


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("plant.parameters={m1=2.0,m2=1.0}", "plant.parameters.m1=2.0\nplant.parameters.m2=1.0"),
        ("plant.parameters.m1=2.0,plant.parameters.m2=1.0", "plant.parameters={m1=2.0,m2=1.0}"),
        ("plant={parameters={m1=2.0}},controller={kp=1,kd=2}", None),
        ('plant.variables={q={pattern="a{i}"},qd=["w1","w2"]}', None),
        ('plant.variables.q={pattern="a{i}",base=0},controller.kp=[[10,0],[0,10]]', None),
        ('plant.parameters.note="a,b=c",controller.kd=1e-3', None),
        ("plant.parameters.note='a,b={',controller.kd=1", None),
        ('plant.parameters={note="}],x=1",m1=[1,2]}, controller.kd = 1', None),
        ('plant.parameters."arm.q[1]"=2,controller.kp=+3', None),
        ("plant.parameters.d=[{a=1,b=2}],controller.kp=3", None),
        (
            "plant.fmu=two_link_arm,plant.parameters={m1=1,m2=2}",
            'plant.fmu="two_link_arm"\nplant.parameters={m1=1,m2=2}',
        ),
        ("plant.fmu=a b=c.fmu,plant.isolate=false", 'plant.fmu="a b=c.fmu"\nplant.isolate=false'),
        ("beta=0.9,alpha=fast", 'beta=0.9\nalpha="fast"'),
    ],
)
def test_a_change_is_parsed_as_toml(text, lines):
    def cut(text, depth=0, quote=""):
        """Return the text with line breaks for those commas that are in no brackets or quotes."""
        out = ""
        for char in text:
            if quote:
                quote = "" if char == quote else quote
            elif char in "\"'":
                quote = char
            depth += (char in "[{") - (char in "]}") if not quote else 0
            out += "\n" if char == "," and not depth and not quote else char
        return out

    assert nested(Change.of("--plant", text)) == tomllib.loads(lines or cut(text))


def test_robots_are_given_as_ranges_anywhere_in_a_change():
    for text in (
        "robots=1-3,7,controller.kp=1",
        "controller.kp=1,robots=1-3,7",
        "robots = 7,1-3,controller.kp=1",
    ):
        change = Change.of("--plant", text)
        assert (change.robots, nested(change)) == ((1, 2, 3, 7), {"controller": {"kp": 1}})


@pytest.mark.parametrize(
    ("text", "result"),
    [
        ("fmu", "--plant: expected key=value, got 'fmu'"),
        ("", "--plant: expected key=value, got ''"),
        ("=3", "--plant: expected key=value, got '=3'"),
        ("robots=2", "--plant: changes nothing"),
        ("plant.parameters={m1=2.0", "plant.parameters: expected a key and a value of TOML, got"),
        ("plant.parameters={m1=two,m2=1}", "plant.parameters: expected a key and a value of TOML"),
        ("robots=2,robots=3,controller.kp=1", "robots: is given twice"),
        (
            "plant.parameters.q[0]=1",
            "plant.parameters.q[0]: expected a key and a value of TOML, got "
            "'plant.parameters.q[0]=1'; a list is given whole, as plant.parameters.q=[…], and a "
            "name that has brackets in quotation marks",
        ),
        ("controller.kp=1,controller.kp=2", "controller.kp: is given twice in"),
        ("plant.parameters={m1=1},plant.parameters.m1=2", "plant.parameters.m1: is given twice"),
    ],
)
def test_a_malformed_change_is_named(text, result):
    with pytest.raises(InputError) as error:
        Change.of("--plant", text)
    assert result in str(error.value)


def after(file, text):
    return changed(file, [Change.of("--plant", text).of_plants()]).scenario


def test_a_change_keeps_the_keys_that_it_does_not_name():
    file = paper(OTHER)
    plant = after(file, "plant.parameters={drag=1.0},plant.variables.qd=omega").plant
    assert plant.fmu == "own.fmu"
    assert plant.parameters == {"mass": 3.0, "drag": 1.0}
    assert plant.variables == {"q": "theta", "qd": "omega"}
    own = after(file, "robots=2,controller.kp=20,plant.variables.q={pattern='a{i}'}").robots[0]
    assert own.controller.model_fields_set == {"kp"}
    assert own.plant.variables == {"q": Pattern(pattern="a{i}")}


@pytest.mark.parametrize("whose", ["", "robots=2,"])
def test_another_fmu_drops_the_parameters_and_variables_of_the_old_one(whose):
    scenario = after(paper(OTHER), f"{whose}plant.parameters.m1=2.0,plant.fmu=two_link_arm")
    plant = scenario.robots[0].plant if whose else scenario.plant
    assert (plant.fmu, plant.parameters, plant.variables) == ("two_link_arm", {"m1": 2.0}, {})


def test_a_file_in_a_change_is_relative_to_the_current_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other.fmu").touch()
    for text in ("plant.fmu=other.fmu", "plant.fmu='other.fmu'", "plant={fmu='other.fmu'}"):
        assert after(paper(), text).plant.fmu == str(tmp_path / "other.fmu")
    assert after(paper(), "plant.fmu=none.fmu").plant.fmu == "none.fmu"


def test_a_number_in_a_key_is_a_place_in_a_list():
    changed = with_changes(
        toml({"faults.links": [{"loss": 0.1}, {"to": 2, "delay": 1}]}),
        [Change.of("--set", "faults.links.1.delay=2,faults.links.0.loss=0.3")],
    )
    assert tomllib.loads(changed)["faults"]["links"] == [{"loss": 0.3}, {"to": 2, "delay": 2}]
    new = with_changes(toml(), [Change.of("--set", "faults.links.0.loss=0.3")])
    assert tomllib.loads(new)["faults"]["links"] == [{"loss": 0.3}]


@pytest.mark.parametrize("own", ["", "robots=2,"])
@pytest.mark.parametrize("was", [{"q": [0.1, 0.2]}, {}])
@pytest.mark.parametrize(
    ("text", "q"),
    [
        ("initial.q.uniform=[-0.3,0.3]", {"uniform": [-0.3, 0.3]}),
        ("initial={q={uniform=[-0.3,0.3]}}", {"uniform": [-0.3, 0.3]}),
        ("initial.q.0=0.3", [0.3]),
    ],
)
def test_a_table_takes_the_place_of_a_list_of_numbers_and_a_place_that_of_nothing(
    was, own, text, q
):
    entry = f"q = {was['q']}" if was else ""
    changed = with_changes(
        f"[initial]\n{entry}\n[[robots]]\nid = 2\ninitial = {{ {entry} }}",
        [Change.of("--set", own + text)],
    )
    tables = tomllib.loads(changed)
    expected = [*q, *was.get("q", [])[1:]] if isinstance(q, list) else q
    assert (tables["robots"][0] if own else tables)["initial"] == {"q": expected}
    assert (tables if own else tables["robots"][0])["initial"] == was


def test_a_place_that_a_list_does_not_have_is_told():
    for key in ("faults.links.2.loss", "faults.links.loss", "network.pinning.6"):
        where = re.escape(key.replace("2.loss", "2"))
        with pytest.raises(InputError, match=f"^{where}: expected a place in a list of"):
            with_changes(
                toml({"faults.links": [{"loss": 0.1}, {"delay": 1}]}),
                [Change.of("--set", f"{key}=0.3")],
            )


@pytest.mark.parametrize(
    ("change", "gone"),
    [
        ("run.h=0.2", {"above", "two lines", "beside"}),
        ("run.h=0.1", set()),
        ("run.b.c=1", {"dotted"}),
        ("run.q.a=2", {"inline"}),
        ("run.d=[1]", {"within", "after"}),
        ("run.new=1", {"of the table"}),
    ],
)
def test_what_a_comment_says_of_a_value_goes_with_it(change, gone):
    text = """# all

[run]  # of the table
# apart

# above
# two lines
h = 0.1  # beside
b.c = 3  # dotted
q = {a = 1}  # inline
d = [1,  # within
  2]  # after
e = true  # last
"""

    def comments(text):
        return {line.partition("#")[2].strip() for line in text.splitlines() if "#" in line}

    changed = with_changes(text, [Change.of("--set", change)])
    assert comments(text) - comments(changed) == gone
