"""Message types of declared fields, against protobuf's own runtime; and what may be declared."""

import re

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import ESTIMATE, Field, Sizes, column_names, wrong_fields
from nrs_cosim.bus.messages import LINK_EVENT, MEASUREMENT, SAMPLE, STATE

SIZES = Sizes(m=2, n=5, in_degree=3)
RNG = np.random.default_rng(11)
THIRD = {**ESTIMATE, "acceleration": Field(truth="acceleration")}
ODD = {
    "level": Field(()),
    "P": Field((2, "m"), doc="covariance"),
    "seen": Field(("in_degree",)),
    "of_each": Field(("n", "m", 3)),
}
MANY = {f"x{number}q": Field(() if number % 3 else ("m",)) for number in range(40)}
DECLARED = {
    "third order": THIRD,
    "one number": {"position": Field(), "to": Field((1,))},
    "scalars and matrices": ODD,
    "more than fit tags of one byte": MANY,
}


def message_class(kind):
    """Return the class that protobuf itself makes of our descriptor."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(kind.descriptor()).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(kind.name))


@pytest.mark.parametrize("sent", DECLARED.values(), ids=DECLARED)
def test_declared_messages_have_the_bytes_of_protobuf(sent):
    codecs = Codecs.of(SIZES, "Mine", sent, {**ESTIMATE, **sent}, duplicates=True)
    for codec in (codecs.samples, codecs.link_events):
        records = codec.blank(np.array([0, 3, 70_000]))
        records["k"], records["time_ns"] = 12, 1_200_000_000
        for name in codec.kind.counts:
            records[name] = RNG.integers(0, 2**32, 3)
        for name, shape in codec.shapes.items():
            records[name] = RNG.normal(size=(3, *shape))
            records[name][1] = 0.0
        theirs = message_class(codec.kind)
        for record, payload in zip(records, codec.encode(records), strict=True):
            fields = {
                name: np.ravel(record[name]).tolist() if shape else float(record[name])
                for name, shape in codec.shapes.items()
            }
            counts = {name: int(record[name]) for name in codec.kind.counts}
            opening = {"robot": int(record["robot"]), "k": 12, "time_ns": 1_200_000_000}
            other = theirs(**opening, **counts, **fields)
            assert payload == other.SerializeToString(deterministic=True)
            assert theirs.FromString(payload) == other
        assert codec.decode(codec.encode(records)).tobytes() == records.tobytes()


def test_arrays_have_their_shapes_and_scalars_are_0_dimensional():
    codec = Codecs.of(SIZES, "Mine", ODD).samples
    records = codec.blank(np.array([1, 2]))
    assert {name: records[name].shape for name in ODD} == {
        "level": (2,),
        "P": (2, 2, 2),
        "seen": (2, 3),
        "of_each": (2, 5, 2, 3),
    }


@pytest.mark.parametrize(
    ("sent", "size"), [(ESTIMATE, 55), (THIRD, 73), ({"position": Field(), "to": Field((1,))}, 47)]
)
def test_a_message_has_as_many_bytes_as_its_fields_take(sent, size):
    assert Codecs.of(SIZES, "Mine", sent).samples.size == size


def test_position_and_velocity_have_the_standing_types():
    for sent in (ESTIMATE, {name: Field(doc="other words") for name in ESTIMATE}):
        codecs = Codecs.of(SIZES, "Mine", sent)
        assert codecs.samples.kind is SAMPLE
        assert codecs.states.kind is STATE
        assert codecs.link_events.kind.descriptor() == LINK_EVENT.descriptor()
        assert codecs.of_agents == {}
        measured = Codecs.of(SIZES, "Mine", sent, measured=True).of_agents
        assert [codec.kind for codec in measured.values()] == [MEASUREMENT]


@pytest.mark.parametrize(
    "sent",
    [
        THIRD,
        {"velocity": Field(), "position": Field()},
        {"position": Field(), "velocity": Field((2,))},
    ],
)
def test_other_fields_have_a_type_of_the_class_own(sent):
    codecs = Codecs.of(SIZES, "Mine", sent, {**ESTIMATE, "integral": Field()}, measured=True)
    assert [kind.name for kind in codecs.types] == [
        "nrs.Mine.Sample",
        "nrs.State",
        "nrs.Mine.LinkEvent",
        "nrs.Mine.AgentState",
        "nrs.Mine.Measurement",
    ]
    assert list(codecs.of_agents["agent_state"].kind.fields) == ["integral"]
    assert codecs.of_agents["measurement"].shapes == codecs.samples.shapes
    assert list(codecs.samples.kind.fields) == list(sent)


def test_a_schema_says_what_each_field_means_or_how_it_is_called():
    codecs = Codecs.of(SIZES, "Mine", ODD, {**ESTIMATE, "integral": Field()})
    docs = {
        kind.name: [entry.doc for entry in kind.fields.values()]
        for kind in codecs.types
        if kind is not STATE
    }
    arrives = "what arrives, zeros when nothing does"
    assert docs == {
        "nrs.Mine.Sample": ["level", "covariance", "seen", "of_each"],
        "nrs.Mine.LinkEvent": [arrives, f"covariance; {arrives}", arrives, arrives],
        "nrs.Mine.AgentState": ["integral"],
    }


def test_duplicates_are_a_new_field_behind_the_old_ones():
    kind = Codecs.of(SIZES, duplicates=True).link_events.kind
    assert [(number, name) for number, name, _ in kind.numbered][-2:] == [
        (9, "velocity"),
        (10, "duplicates"),
    ]


def test_each_number_of_an_array_has_its_own_column():
    assert column_names("level", ()) == ["level"]
    assert column_names("x", (2,)) == ["x_1", "x_2"]
    assert column_names("P", (2, 2)) == ["P_1_1", "P_1_2", "P_2_1", "P_2_2"]


LARGEST = {"x": Field((2**10, 2**10))}


@pytest.mark.parametrize("fields", [ESTIMATE, THIRD, ODD, MANY, LARGEST], ids=str)
def test_sound_fields_have_nothing_wrong(fields):
    assert list(wrong_fields(fields)) == []


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"2x": Field()}, "'2x': expected a name of letters, digits and _"),
        ({"lambda": Field()}, "'lambda': expected a name"),
        ({"x.y": Field()}, "'x.y': expected a name"),
        ({"_x": Field()}, "'_x': expected a name"),
        ({"delay": Field()}, "delay: is a name that every message has"),
        ({"x_y": Field(), "xY": Field()}, "xY: differs from x_y in case or _ alone"),
        ({"x": Field((2,)), "x_1": Field(())}, "x_1: is what a column of x may be called"),
        ({"x": Field((3, 3)), "x_1_2": Field(())}, "x_1_2: is what a column of x may be called"),
        ({"x": ("m",)}, r"x: expected a Field, got \('m',\)"),
        ({"x": Field(("q",))}, r"x: shape: expected a tuple .*got \('q',\)"),
        ({"x": Field((0,))}, "x: shape: expected"),
        ({"x": Field((True,))}, "x: shape: expected"),
        ({"x": Field("m")}, "x: shape: expected a tuple"),
        ({"x": Field((1,) * 5)}, "x: shape: expected at most 4 axes, got 5"),
        ({"x": Field((2**11, 2**11))}, "x: shape: expected at most 1048576 numbers"),
        ({"x": Field(initial=float("nan"))}, "x: initial: expected a finite number, got nan"),
        ({"x": Field(truth="jerk")}, "x: truth: expected one of position, velocity, acceleration"),
        ({"x": Field(unit=3)}, "x: unit: expected text, got 3"),
    ],
)
def test_an_impossible_field_declaration_is_named(fields, words):
    (found,) = wrong_fields(fields)
    assert re.match(words, found), found


def test_all_impossible_declarations_are_named_at_once():
    found = list(wrong_fields({"2x": Field(), "y": Field(("q",)), "z": Field(truth="jerk")}))
    assert [text.partition(":")[0] for text in found] == ["'2x'", "y", "z"]
