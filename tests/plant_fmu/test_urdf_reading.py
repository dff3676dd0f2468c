"""What a URDF file must be to be read, what is warned of, and all that is told of a wrong one."""

from dataclasses import replace
from pathlib import Path

import pytest

from nrs_cosim.plant_fmu.bundled.urdf import read_urdf
from nrs_cosim.plant_fmu.bundled.urdf_robot import Limits, UrdfRobot
from nrs_cosim.plant_fmu.errors import FmuError

BODY = '<mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
JOINT = (
    '<joint name="j" type="revolute"><parent link="base"/><child link="arm"/>'
    '<axis xyz="0 0 1"/></joint>'
)
FIXED = '<joint name="{}" type="fixed"><parent link="{}"/><child link="{}"/></joint>'


def robot(links: str = "", joints: str = JOINT) -> str:
    arm = f'<link name="base"/><link name="arm"><inertial>{BODY}</inertial></link>'
    return f'<robot name="r">{arm}{links}{joints}</robot>'


ONE = robot()
GIVE = (
    "all that moves with it included; give an <inertial> with a positive mass and inertia; CAD "
    "data have them, and files of the robot that are made for simulation"
)
NO_INERTIA = f"link 'arm': no inertia about its joint's axis, {GIVE}"
NO_BASE = (
    "is not supported, for the base is fixed; lock it (--lock), or begin at its child (--base-link)"
)
EXPAND = "is a xacro file; expand it first: xacro robot.urdf.xacro > robot.urdf"

WRONG = {
    "not XML": ("robot: arm", "is no XML: Start tag expected, '<' not found: line 1, column 1"),
    "another format": ("<sdf/>", "has no <robot>: its root is <sdf>"),
    "a name that ends a comment": (
        ONE.replace('"j"', '"j*/"'),
        "joint 'j*/': a name is made of printable characters other than *",
    ),
    "two of a name": (
        ONE.replace('"base"', '"arm"'),
        "link 'arm': there are two links of this name; give one of them another",
    ),
    "a planar joint": (ONE.replace("revolute", "planar"), f"joint 'j': type 'planar' {NO_BASE}"),
    "a floating joint": (
        ONE.replace("revolute", "floating"),
        f"joint 'j': type 'floating' {NO_BASE}",
    ),
    "an unknown joint": (
        ONE.replace("revolute", "ball"),
        "joint 'j': type: expected revolute, continuous, prismatic or fixed, got 'ball'",
    ),
    "limits the wrong way round": (
        ONE.replace("<axis", '<limit lower="1.9" upper="-1.9"/><axis'),
        "joint 'j': <limit>: expected a lower of at most upper, got 1.9 and -1.9",
    ),
    "mimic of nothing": (
        ONE.replace("<axis", '<mimic joint="jj"/><axis'),
        "joint 'j': <mimic>: there is no joint 'jj'; did you mean 'j'?",
    ),
    "mimic of itself": (
        ONE.replace("<axis", '<mimic joint="j"/><axis'),
        "joint 'j': <mimic>: it follows itself; expected one joint that leads",
    ),
    "an axis of no direction": (
        ONE.replace("0 0 1", "0 0 0"),
        "joint 'j': <axis> xyz: expected a direction, got 0 0 0",
    ),
    "half an axis": (
        ONE.replace("0 0 1", "0 1"),
        "joint 'j': <axis> xyz: expected 3 numbers, got '0 1'",
    ),
    "a number of Python": (
        ONE.replace('ixx="1"', 'ixx="1_0"'),
        "link 'arm': <inertial> <inertia> ixx: expected a number, got '1_0'",
    ),
    "a number beyond all robots": (
        ONE.replace('ixx="1"', 'ixx="1e200"'),
        "link 'arm': <inertial> <inertia> ixx: expected a number up to 1e+30, got '1e200'",
    ),
    "an unknown link": (
        ONE.replace('child link="arm"', 'child link="leg"'),
        "joint 'j': <child>: there is no link 'leg'",
    ),
    "negative damping": (
        ONE.replace("<axis", '<dynamics damping="-1"/><axis'),
        "joint 'j': <dynamics> damping: expected 0 or more, got -1",
    ),
    "no moving joint": (
        robot(joints=FIXED.format("j", "base", "arm")),
        "has no moving joint; expected a revolute, continuous or prismatic one",
    ),
    "two ways to a link": (
        ONE.replace("</robot>", FIXED.format("k", "base", "arm") + "</robot>"),
        "link 'arm': joints 'j' and 'k' both lead to it: a closed loop; "
        "expected an open chain or tree",
    ),
    "a loop apart": (
        robot(
            links='<link name="a"/><link name="b"/>',
            joints=JOINT + FIXED.format("k", "a", "b") + FIXED.format("l", "b", "a"),
        ),
        "links 'a', 'b': in a closed loop of joints; expected an open chain or tree",
    ),
    "two bases": (
        robot(links='<link name="other"/>'),
        "links 'base', 'other': without a joint that leads there; expected one base link",
    ),
    "no inertia": (ONE.replace(f"<inertial>{BODY}</inertial>", ""), NO_INERTIA),
    "an inertia of zeros": (ONE.replace('="1"', '="0"'), NO_INERTIA),
    "a point on the axis": (
        ONE.replace('ixx="1"', 'ixx="0"')
        .replace('iyy="1"', 'iyy="0"')
        .replace('izz="1"', 'izz="0"')
        .replace("<mass", '<origin xyz="0 0 0.3"/><mass'),
        NO_INERTIA,
    ),
    "no mass to slide": (
        ONE.replace("revolute", "prismatic").replace('mass value="1"', 'mass value="0"'),
        f"link 'arm': no mass, {GIVE}",
    ),
    "a negative mass": (
        ONE.replace('mass value="1"', 'mass value="-2"'),
        "link 'arm': <inertial> <mass> value: expected 0 or more, got -2",
    ),
    "a negative inertia": (
        ONE.replace('ixx="1"', 'ixx="-1"'),
        "link 'arm': <inertial> <inertia>: expected no negative principal moment, got -1 kg m2",
    ),
    "no inertia tensor": (
        ONE.replace(BODY, '<mass value="1"/>'),
        "link 'arm': <inertial> has no <inertia>; add it",
    ),
    "an inertia that is no number": (
        ONE.replace('izz="1"', 'izz="nan"'),
        "link 'arm': <inertial> <inertia> izz: expected a number, got 'nan'",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_urdf_is_named(tmp_path: Path, case: str) -> None:
    text, message = WRONG[case]
    path = tmp_path / "robot.urdf"
    path.write_text(text, "utf-8")
    with pytest.raises(FmuError) as caught:
        read_urdf(path)
    assert str(caught.value) == f"{path}: {message}"


def test_a_missing_urdf_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match=r"arm\.urdf: cannot be read: No such file or directory"):
        read_urdf(tmp_path / "arm.urdf")


def turning(name: str, parent: str, child: str, within: str = "") -> str:
    return (
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="0 1 0"/>{within}</joint>'
    )


def test_all_faults_of_a_urdf_are_reported_at_once_grouped_by_kind(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    follower = '<mimic joint="j" multiplier="-"/>'
    links = "".join(f'<link name="{name}"/>' for name in ("world", "a", "b", "c", "d"))
    joints = (
        turning("k", "arm", "a", follower)
        + turning("l", "arm", "b", follower)
        + turning("m", "base", "c").replace("0 1 0", "0 1")
        + turning("n", "base", "d").replace('type="continuous"', 'type="ball"')
        + turning("o", "world", "base").replace('type="continuous"', 'type="floating"')
    )
    path.write_text(robot(links, JOINT + joints).replace('izz="1"', 'izz="one"'), "utf-8")
    with pytest.raises(FmuError) as caught:
        read_urdf(path)
    assert str(caught.value).splitlines() == [
        f"{path}: joints 'k', 'l': <mimic> multiplier: expected a number, got '-'",
        f"{path}: joint 'm': <axis> xyz: expected 3 numbers, got '0 1'",
        f"{path}: joint 'n': type: expected revolute, continuous, prismatic or fixed, got 'ball'",
        f"{path}: joint 'o': type 'floating' {NO_BASE}",
        f"{path}: link 'arm': <inertial> <inertia> izz: expected a number, got 'one'",
        f"{path}: link 'c': no inertia about its joint's axis, {GIVE}",
    ]


# What is enough of inertias


def read(folder: Path, text: str | bytes) -> UrdfRobot:
    path = folder / "robot.urdf"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_urdf(path)


def test_rounding_is_not_taken_for_a_negative_moment(tmp_path: Path) -> None:
    """A point of 1 kg, 0.1 m off its axis: what a tool has rounded is nothing beside 0.01 kg m2."""
    point = (
        '<origin xyz="0.1 0 0"/><mass value="1"/>'
        '<inertia ixx="0" ixy="0" ixz="2e-35" iyy="0" iyz="0" izz="0"/>'
    )
    found = read(tmp_path, ONE.replace(BODY, point))
    assert (len(found.axes), found.warnings) == (1, ())


@pytest.mark.parametrize(("moment", "refused"), [("-1e-13", False), ("-1e-11", True)])
def test_small_moments_are_compared_with_the_largest_of_the_robot(
    tmp_path: Path, moment: str, refused: bool
) -> None:
    """The arm has 1 kg m2, of whose last digits a finger's moments may be made."""
    small = BODY.replace('="1"', '="1e-6"').replace('ixx="1e-6"', f'ixx="{moment}"')
    text = robot(
        f'<link name="finger"><inertial>{small}</inertial></link>',
        JOINT + turning("k", "arm", "finger"),
    )
    if refused:
        with pytest.raises(FmuError, match=r"link 'finger': .* principal moment, got -1e-11 kg m2"):
            read(tmp_path, text)
    else:
        assert len(read(tmp_path, text).axes) == 2


def test_a_massless_link_of_a_universal_joint_is_accepted(tmp_path: Path) -> None:
    text = robot(
        '<link name="cross"/>', turning("y", "base", "cross") + JOINT.replace("base", "cross")
    )
    assert read(tmp_path, text).warnings == (
        "link 'cross': no inertia about its joint's axis of its own, and the mass matrix is "
        "positive definite in the posture of zeros and 8 random ones; it may be singular in others",
    )


def test_a_massless_link_between_two_joints_of_one_axis_is_singular(tmp_path: Path) -> None:
    same = turning("z", "base", "cross").replace("0 1 0", "0 0 1")
    with pytest.raises(
        FmuError, match=r"link 'cross': no inertia .*, and the mass matrix is singu"
    ):
        read(tmp_path, robot('<link name="cross"/>', same + JOINT.replace("base", "cross")))


def test_a_massless_link_of_a_universal_joint_is_singular_where_its_rod_lies_along_an_axis(
    tmp_path,
):
    """Only there, where the robot starts: the rod has no inertia about itself."""
    rod = '<origin xyz="0 0 1"/>' + BODY.replace('="1" ixy', '="0" ixy').replace('y="1"', 'y="0"')
    rod = rod.replace('izz="1"', 'izz="0"')
    text = robot(
        '<link name="cross"/>',
        JOINT.replace("arm", "cross") + turning("y", "cross", "arm"),
    ).replace(BODY, rod)
    with pytest.raises(FmuError, match=r"link 'cross': no inertia .* is singular; lock a joint"):
        read(tmp_path, text)


def test_a_massless_link_at_the_end_is_named_alone(tmp_path: Path) -> None:
    links, joints = '<link name="flange"/>', JOINT + turning("k", "arm", "flange")
    with pytest.raises(FmuError) as caught:
        read(tmp_path, robot(links, joints))
    wrong = f"link 'flange': no inertia about its joint's axis, {GIVE}"
    assert str(caught.value) == f"{tmp_path / 'robot.urdf'}: {wrong}"


@pytest.mark.parametrize(
    "inertial",
    [
        '<mass value="1"/>',
        BODY.replace('ixy="0"', 'ixy=""'),
        BODY.replace('value="1"', 'value="-1"'),
        BODY.replace('ixx="1"', 'ixx="-1"'),
    ],
    ids=["mass alone", "an empty number", "negative mass", "negative moment"],
)
@pytest.mark.parametrize("link", ["base", "stand"])
def test_inertias_of_fixed_links_are_ignored(tmp_path: Path, inertial: str, link: str) -> None:
    stand = robot('<link name="stand"/>', JOINT + FIXED.format("k", "base", "stand"))
    wrong = stand.replace(
        f'<link name="{link}"/>', f'<link name="{link}"><inertial>{inertial}</inertial></link>'
    )
    assert read(tmp_path, wrong) == read(tmp_path, stand)


# What others read as well

DECLARED = f'<?xml version="1.0"?>{ONE}'
XACRO = ONE.replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"')
VISUAL = '<visual><origin xyz="0 0 1"/></visual>'


def with_more(text: str, more: str) -> str:
    return text.replace("</robot>", f"{more}</robot>")


LENIENT = {
    "a prefix of nowhere": (
        with_more(ONE, '<gazebo><sensor:camera name="c"/></gazebo>'),
        "the prefix 'sensor' is declared nowhere; what bears it is left out of the dynamics",
    ),
    "an attribute's prefix of nowhere": (
        ONE.replace("<axis", '<limit effort="1" velocity="1" drake:acceleration="3"/><axis'),
        "the prefix 'drake' is declared nowhere; what bears it is left out of the dynamics",
    ),
    "another vocabulary's joint": (
        with_more(ONE, '<other:joint name="k" type="floating"/>'),
        "the prefix 'other' is declared nowhere; what bears it is left out of the dynamics",
    ),
    "a default namespace": (
        ONE.replace("<robot", '<robot xmlns="http://drake.mit.edu"'),
        "its default namespace http://drake.mit.edu is ignored",
    ),
    "a macro that is gone": (
        with_more(XACRO, "<xacro:grey/>"),
        "<xacro:grey> of xacro is left in it, and left out of the dynamics",
    ),
    "xacro of no namespace": (
        with_more(ONE, "<gazebo><xacro:grey/></gazebo>"),
        "the prefix 'xacro' is declared nowhere; what bears it is left out of the dynamics",
        "<xacro:grey> of xacro is left in it, and left out of the dynamics",
    ),
    "definitions and looks of xacro": (
        with_more(
            XACRO,
            '<xacro:property name="r" value="1"/><xacro:macro name="paint"><material name="${r}"/>'
            f'</xacro:macro><xacro:if value="1">{VISUAL}</xacro:if><xacro:paint/>'
            '<gazebo><xacro:include filename="a.xacro"/></gazebo>',
        ),
        "<xacro:property>, <xacro:macro>, <xacro:if>, <xacro:paint>, <xacro:include> of xacro is "
        "left in it, and left out of the dynamics",
    ),
    "blanks before the declaration": (
        f"\n  {DECLARED}",
        "there are blanks before its XML declaration",
    ),
    "a byte order mark and blanks": (
        f"\ufeff\n{DECLARED}",
        "there are blanks before its XML declaration",
    ),
    "a comment in Latin-1": (
        with_more(DECLARED, "<!-- Gelenk für -->").encode("latin-1"),
        "has bytes that are not of its encoding; it is read as Latin-1",
    ),
    "UTF-16": (f'<?xml version="1.0" encoding="utf-16"?>{ONE}'.encode("utf-16"),),
    "Latin-1 that is declared": (
        f'<?xml version="1.0" encoding="iso-8859-1"?><!-- für -->{ONE}'.encode("latin-1"),
    ),
    "two hyphens in a comment": (with_more(ONE, "<!-- a -- b -->"),),
    "no name": (
        ONE.replace(' name="r"', ""),
        "its <robot> has no name; it is called 'robot'",
    ),
    "no axis": (
        ONE.replace('<axis xyz="0 0 1"/>', "").replace("<parent", '<origin rpy="0 0 0"/><parent'),
        "joint 'j': has no <axis>; URDF's default of 1 0 0 is taken",
    ),
}


@pytest.mark.parametrize("case", LENIENT)
def test_urdf_deviations_that_others_accept_give_a_warning(tmp_path: Path, case: str) -> None:
    text, *warnings = LENIENT[case]
    plain = read(tmp_path, ONE)
    if case == "no name":
        plain = replace(plain, name="robot")
    if case == "no axis":
        plain = replace(plain, joints=(replace(plain.joints[0], axis=(1.0, 0.0, 0.0)),))
    if case == "an attribute's prefix of nowhere":
        limited = replace(plain.joints[0], limits=Limits(0.0, 0.0, 1.0))
        plain = replace(plain, joints=(limited,))
    assert read(tmp_path, text) == replace(plain, warnings=tuple(warnings))


@pytest.mark.parametrize("case", [c for c in LENIENT if c not in {"UTF-16", "no name"}])
def test_another_parser_accepts_what_gives_a_warning(tmp_path: Path, case: str) -> None:
    """By urdfdom, in Pinocchio; that one asks for a name, for limits, and for bytes of ASCII."""
    pinocchio = pytest.importorskip("pinocchio", reason="needs the package pin, of the extra test")
    text, *_ = LENIENT[case]
    limit = b'<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    path = tmp_path / "robot.urdf"
    path.write_bytes(
        (text if isinstance(text, bytes) else text.encode()).replace(b"</joint>", limit)
    )
    model = pinocchio.buildModelFromUrdf(str(path))
    kind = "JointModelRX" if case == "no axis" else "JointModelRZ"
    assert [(model.names[i], model.joints[i].shortname()) for i in range(1, model.njoints)] == [
        ("j", kind)
    ]


UNEXPANDED = {
    "another file": '<xacro:include filename="arm.xacro"/>',
    "a macro that gives a link": (
        '<xacro:macro name="arm" params="n"><link name="${n}"/></xacro:macro><xacro:arm n="k"/>'
    ),
    "a macro of a macro": (
        '<xacro:macro name="a"><xacro:b/></xacro:macro><xacro:macro name="b"><xacro:a/>'
        '<joint name="k"/></xacro:macro><xacro:a/>'
    ),
    "a condition about a joint": f'<xacro:if value="1">{FIXED.format("k", "base", "x")}</xacro:if>',
    "a block within a link": '<link name="x"><xacro:insert_block name="inertial"/></link>',
    "an expression": '<link name="${prefix}hand"/>',
    "a substitution": '<joint name="$(arg name)" type="fixed"/>',
}


@pytest.mark.parametrize("case", UNEXPANDED)
def test_unexpanded_xacro_is_refused(tmp_path: Path, case: str) -> None:
    with pytest.raises(FmuError) as caught:
        read(tmp_path, with_more(XACRO, UNEXPANDED[case]))
    assert str(caught.value) == f"{tmp_path / 'robot.urdf'}: {EXPAND}"


def test_a_file_of_macros_only_is_refused(tmp_path: Path) -> None:
    macro = '<robot name="r"><xacro:macro name="arm"><link name="a"/></xacro:macro></robot>'
    with pytest.raises(FmuError, match="is a xacro file"):
        read(tmp_path, macro.replace("<robot", '<robot xmlns:xacro="http://ros.org/wiki/xacro"'))


LAUGHS = "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 10))
HOSTILE = {
    "entities": (f'<!DOCTYPE robot [<!ENTITY a "1">]>{ONE}', "document type declaration"),
    "entities of entities": (
        f'<!DOCTYPE robot [<!ENTITY a0 "ha">{LAUGHS}]>' + ONE.replace('"r"', '"&a9;"'),
        "document type declaration|is no XML",
    ),
    "another file": (
        '<!DOCTYPE robot [<!ENTITY a SYSTEM "file:///etc/hostname">]>' + with_more(ONE, "&a;"),
        "document type declaration",
    ),
    "a document type elsewhere": (
        f'<!DOCTYPE robot SYSTEM "http://localhost/robot.dtd">{ONE}',
        "document type declaration",
    ),
    "elements without end": (f"<robot>{'<a>' * 100_000}", "is no XML"),
    "nothing": ("", "is no XML: Document is empty"),
    "a control character": (ONE.replace('"r"', '"r\x01"'), "is no XML: invalid character"),
    "a second root": (ONE + ONE, "is no XML: Extra content"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_document_with_entities_or_wrong_encoding_is_refused(tmp_path: Path, case: str) -> None:
    text, message = HOSTILE[case]
    with pytest.raises(FmuError, match=message):
        read(tmp_path, text)


def test_an_endless_file_is_not_read_to_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("nrs_cosim.plant_fmu.bundled.urdf_xml.MOST_BYTES", 1 << 20)
    with pytest.raises(FmuError, match=r"robot\.urdf: is larger than 1 MiB"):
        read(tmp_path, with_more(ONE, " " * (1 << 20)))


INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


@pytest.mark.parametrize("joints", [500, 501, 3000])
def test_a_tree_that_is_too_deep_is_refused_by_name(tmp_path, joints):
    ones = " ".join(f'{axes}="{int(axes[1] == axes[2])}"' for axes in INERTIA)
    inertial = f'<inertial><mass value="1"/><inertia {ones}/></inertial>'
    links = "".join(f'<link name="l{i}">{inertial}</link>' for i in range(joints + 1))
    kinds = ["fixed"] * (joints - 1) + ["revolute"]
    chain = "".join(
        f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for i, kind in enumerate(kinds)
    )
    path = tmp_path / "deep.urdf"
    path.write_text(f'<robot name="deep">{links}{chain}</robot>', "utf-8")
    if joints == 500:
        assert len(read_urdf(path).joints) == 500
        return
    with pytest.raises(FmuError, match=rf"joint 'j500': is the first of {joints - 500} that lie"):
        read_urdf(path)
