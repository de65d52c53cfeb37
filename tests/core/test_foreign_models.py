"""PICT and ACTS models: what they say, what is refused by name, and what an export leaves out."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pipeline.__main__ import main
from pipeline.artefacts.model_export import write_model
from pipeline.artefacts.space_formats import read_space_of_any_format
from pipeline.core.space import Space, Variable
from pipeline.errors import InputError

PICT = """
# Volumes
Type:        Single (10), Span, RAID-5 | Raid5 (2)
Size:        10, 500, 40000
File system: FAT, NTFS
Second:      <File system>, none

IF [File system] = "FAT" THEN [Size] <= 4096;
[Second] = "none" OR [Second] <> [File system];
"""
ACTS = """-- made by hand
[System]
Name: brake
[Parameter]
speed (int) : 10, 30, 50
wet (boolean) : true, false
tyre (enum) : new, worn out
[Constraint]
wet => speed < 50
tyre != "worn out" || !wet
"""
ACTS_XML = """<?xml version="1.0" encoding="UTF-8"?>
<System name="brake">
  <Parameters>
    <Parameter id="0" name="speed" type="0">
      <values><value>10</value><value>30</value><value>50</value></values>
      <basechoices /><invalidValues /></Parameter>
    <Parameter id="1" name="wet" type="2">
      <values><value>true</value><value>false</value></values></Parameter>
    <Parameter id="2" name="tyre" type="1">
      <values><value>new</value><value>worn out</value></values></Parameter>
  </Parameters>
  <OutputParameters /><Relations><Relation Strength="2" Default="true" /></Relations>
  <Constraints>
    <Constraint text="wet =&gt; speed &lt; 50">
      <Parameters><Parameter name="wet" /></Parameters></Constraint>
    <Constraint text="tyre != &quot;worn out&quot; || !wet"><Parameters /></Constraint>
  </Constraints>
</System>
"""


def read(folder: Path, text: str, name: str = "model.txt") -> Space:
    (folder / name).write_text(text)
    return read_space_of_any_format(folder / name)


def test_a_pict_model_is_a_space(tmp_path: Path) -> None:
    space = read(tmp_path, PICT)
    assert space.names == ("Type", "Size", "File system", "Second")
    assert space.variables[0].values == ("Single", "Span", "RAID-5") and space.weights[0] == (
        10,
        1,
        2,
    )
    assert space.variables[3].values == ("FAT", "NTFS", "none")
    assert space.clauses == (
        ("Size != 40000", "File system != FAT"),
        ("File system != FAT", "Second != FAT"),
        ("File system != NTFS", "Second != NTFS"),
    )


@pytest.mark.parametrize(("text", "name"), [(ACTS, "model.txt"), (ACTS_XML, "model.xml")])
def test_both_forms_of_an_acts_model_are_one_space(text: str, name: str, tmp_path: Path) -> None:
    space = read(tmp_path, text, name)
    assert {v.name: v.values for v in space.variables} == {
        "speed": ("10", "30", "50"),
        "wet": ("true", "false"),
        "tyre": ("new", "worn out"),
    }
    assert space.clauses == (("speed != 50", "wet != true"), ("wet != true", "tyre != worn out"))


REFUSED = [
    (
        "A: 1, 2\nB: x\n{ A, B } @ 2\n",
        "model.txt: line 3: the sub-model { A, B } @ 2 has a strength of its own",
    ),
    ("A: 1, ~2\n", "line 1: ~2 is a negative value, which a space does not have"),
    ("A: 1\n$R: ok, bad\n", "line 2: $R is a result parameter"),
    ("A @ 3: 1, 2\n", "line 1: the parameter A @ 3 has a strength of its own"),
    ("A: 1, 2\na: 3\n", "line 2: the parameter a appears twice"),
    ("A: x, y, x\n", "line 1: the value 'x' of A appears twice"),
    ("A: x (2000)\n", "line 1: the weight of x must be at most 1000, got 2000"),
    ("A\n", "line 1: expected a parameter such as 'Size: 1, 2, 3', got 'A'"),
    ("# nothing\n", "expected parameters such as 'Size: 1, 2, 3', got none"),
    ("A: 1, 2\n\nIF [A] = 1 [A] = 2;\n", "line 3: expected THEN, got A"),
    ("A: 1, 2\n[A] = 1\n", "line 2: expected ';', got the end"),
    ('A: 1, 2\n[A] = "x";\n', "line 2: expected a number to compare [A] with, got x"),
    ("A: x, y\n[A] = 1;\n", "line 2: expected a text in double quotes to compare [A] with, got 1"),
    ("A: x, y\n[A] ~ 1;\n", "line 2: expected a constraint, got '~ 1;'"),
    ('A: x, y\n[A] "x";\n', "line 2: expected one of =, <>, <, <=, >, >=, IN, LIKE, got x"),
    ('Size: x, y\n[Sise] = "x";\n', "line 2: there is no parameter [Sise]; did you mean 'Size'?"),
    ("A: 1, 2\nB: x\n[A] = [B];\n", "line 3: [A] and [B] cannot be compared"),
    ('A: 1, 2\n[A] LIKE "1*";\n', "line 2: expected LIKE to compare texts, not numbers"),
    ("A: 1, 2\nIF ISNEGATIVE(A) THEN [A] = 1;\n", "line 2: ISNEGATIVE asks for negative values"),
    ("A: 1, 2\n[A] > 2;\n", "line 2: no combination satisfies it"),
    ("A: 1, 2\n[A] = 1;\n[A] = 2;\n", "constraints: these contradict each other"),
    (
        'a=b: x, y, z\n[a=b] = "y";\n',
        "line 2: names in constraints must not contain '=' or '!=', or have spaces at their ends",
    ),
    ("A: 1\n" + "(" * 5000 + "[A] = 1;\n", "line 2: nested too deeply"),
    ("[Parameter]\n[System]\n", "expected parameters such as"),
    (
        "[System]\n[Parameter]\na: 1\n[Relation]\nR1 : (a, b, 3)\n",
        "line 5: relations have strengths of their own",
    ),
    (
        "[System]\n[Parameter]\na: 1\n[Test Set]\na\n",
        "line 5: existing tests are no part of a space; name their table by --include",
    ),
    (
        "[System]\n[Parameters]\na: 1\n",
        "line 2: unknown section [Parameters]; did you mean 'parameter'?",
    ),
    (
        "[System]\n[Parameter]\na (int) : 1, x\n",
        "line 3: expected numbers as values of a, got 1, x",
    ),
    (
        "[System]\n[Parameter]\na (real) : 1\n",
        "line 3: the type of a must be int, enum or boolean, got 'real'",
    ),
    ("[System]\n[Parameter]\na : 1, 2; 9\n", "line 3: a has invalid values after the ';'"),
    (
        "[System]\n[Parameter]\na : 1, 1\n",
        "line 3: the values of a must be distinct and not empty, got 1, 1",
    ),
    ("[System]\n[Parameter]\na : 1\na : 2\n", "line 4: the parameter a appears twice"),
    ("[System]\n[Parameter]\n", "expected parameters, got none"),
    (
        "[System]\n[Parameter]\na: 1\n[Constraint]\na / 2 = 1\n",
        "line 5: the division / is not read",
    ),
    (
        '[System]\n[Parameter]\na: 1\n[Constraint]\na = "x"\n',
        "line 5: a number and a text cannot be compared by =",
    ),
    (
        '[System]\n[Parameter]\na: x\n[Constraint]\na < "x"\n',
        "line 5: a text and a text cannot be compared by <",
    ),
    (
        "[System]\n[Parameter]\nab: 1\n[Constraint]\nac = 1\n",
        "line 5: there is no parameter ac; did you mean 'ab'?",
    ),
    (
        "[System]\n[Parameter]\na: 1\n[Constraint]\na\n",
        "line 5: expected a comparison before the end, got a number",
    ),
    (
        "[System]\n[Parameter]\na: 1\n[Constraint]\na = 1 = 1\n",
        "line 5: expected an operator or the end, got =",
    ),
    (
        "[System]\n[Parameter]\na: 1\n[Constraint]\na % 0 = 1\n",
        "line 5: a number modulo 0 is undefined",
    ),
    ("[System]\n[Parameter]\na: 1\n[Constraint]\n(a = 1\n", "line 5: expected ')', got the end"),
    (
        "[System]\n[Parameter]\na: 1\n[Constraint]\na = #\n",
        "line 5: expected names, numbers, texts in double quotes and operators",
    ),
]


@pytest.mark.parametrize(("text", "message"), REFUSED)
def test_what_a_space_cannot_say_is_refused_with_its_line(
    text: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as refused:
        read(tmp_path, text)
    assert message in str(refused.value) and str(tmp_path / "model.txt") in str(refused.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'type="0"',
            'type="7"',
            "Parameter[1]: expected a name and a type from 0 to 2 (int, enum, boolean), got name "
            "'speed' and type '7'",
        ),
        (
            "<invalidValues />",
            "<invalidValues><invalidValue>9</invalidValue></invalidValues>",
            "Parameter[1]: speed has invalid values",
        ),
        (' Default="true"', "", "System/Relations/Relation: relations have strengths of their own"),
        (
            "wet =&gt;",
            "wett =&gt;",
            "Constraint[1]: there is no parameter wett; did you mean 'wet'?",
        ),
        ("</System>", "", "not valid XML"),
        ("System", "Sut", "expected the element System, got Sut"),
    ],
)
def test_wrong_xml_is_refused_by_place(old: str, new: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        read(tmp_path, ACTS_XML.replace(old, new), "model.xml")
    assert message in str(refused.value)


def test_files_that_are_no_text_are_named(tmp_path: Path) -> None:
    (tmp_path / "model.txt").write_bytes(b"A: \xff\xfe")
    with pytest.raises(InputError, match=r"model.txt: expected a PICT or ACTS model in UTF-8"):
        read_space_of_any_format(tmp_path / "model.txt")
    with pytest.raises(InputError, match=r"nowhere.xml: expected an ACTS model, got No such file"):
        read_space_of_any_format(tmp_path / "nowhere.xml")


INTERVALS = Space(
    (
        Variable("fog", "continuous", "%", 0, 100, cuts=(20, 50), weights=(1, 2, 0)),
        Variable("sun", "continuous", "deg", 0, 360, cuts=(90, 270), cyclic=True),
        Variable("lit", "categorical", values=("no", "yes")),
    ),
    (("fog = [0, 20)", "lit = yes"), ("lit = no", "lit = yes")),
)


@pytest.mark.parametrize("kind", ["pict", "acts", "acts-xml", "space"])
def test_parts_of_intervals_become_names_in_models(kind: str, tmp_path: Path) -> None:
    path = tmp_path / {"acts-xml": "m.xml", "space": "m.yaml"}.get(kind, "m.txt")
    left_out = write_model(path, INTERVALS, kind)
    back = read_space_of_any_format(path)
    assert back.sizes == INTERVALS.sizes and back.constraints.feasible_cells([0, 2]).tolist() == [
        [True, True],
        [False, True],
        [False, True],
    ]
    if kind == "space":
        assert (
            back.variables[:2] == (INTERVALS.variables[0], back.variables[1])
            and back.variables[1].labels == INTERVALS.variables[1].labels
        )
        assert not left_out
    else:
        assert back.variables[0].values == ("[0 .. 20)", "[20 .. 50)", "[50 .. 100]")
        weights = "the weights of 0 of fog" if kind == "pict" else "the weights of fog"
        assert (
            weights in left_out
            and "that sun is a number; its parts become names such as [90 .. 270)" in left_out
        )


@pytest.mark.parametrize(
    ("name", "values", "kind", "message"),
    [
        ("a", ("x, y", "z"), "pict", "a: PICT cannot write this name or its values x, y, z"),
        ("a", ("x|y", "z"), "pict", "a: PICT cannot write"),
        ("a", ("~x", "z"), "pict", "a: PICT cannot write"),
        ("a", ("x (3)", "z"), "pict", "a: PICT cannot write"),
        ("[a]", ("x", "z"), "pict", "[a]: PICT cannot write"),
        ("a", ("x", "X"), "pict", "a: PICT treats some of the values x, X as the same"),
        (
            "a b",
            ("x", "z"),
            "acts",
            "a b: the name of an ACTS parameter consists of letters, digits and _",
        ),
        ("a", ("x;y", "z"), "acts-xml", "a: ACTS cannot write the value 'x;y'"),
    ],
)
def test_names_that_a_format_cannot_write_are_refused(
    name: str, values: tuple[str, ...], kind: str, message: str, tmp_path: Path
) -> None:
    other = Variable("other", "categorical", values=("p", "q"))
    space = Space(
        (other, Variable(name, "categorical", values=values)),
        ((f"{name} = {values[0]}", "other = p"),),
    )
    with pytest.raises(InputError) as refused:
        write_model(tmp_path / "m.txt", space, kind)
    assert message in str(refused.value) and not (tmp_path / "m.txt").exists()


def test_models_are_planned_scored_and_exported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "model.txt").write_text(PICT)
    (tmp_path / "rows.csv").write_text(
        "Type,Size,File system,Second\nSingle,10,FAT,NTFS\nRaid5,500,NTFS,none\n"
    )
    words = [
        "coverage",
        "score",
        "--space",
        str(tmp_path / "model.txt"),
        "--points",
        str(tmp_path / "rows.csv"),
        "--k",
        "1",
        "--json",
    ]
    assert main(words) == 0
    found = json.loads(capsys.readouterr().out)
    # Type wants 13 points and has one: the second row has another name than the first one of its
    # value.
    assert (found["numerator"], found["denominator"], found["partial"]) == (
        1 + 2 + 2 + 2,
        13 + 3 + 2 + 3,
        1,
    )
    words = [
        "coverage",
        "export",
        "--space",
        str(tmp_path / "model.txt"),
        "--output",
        str(tmp_path / "model.yaml"),
        "--json",
    ]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out) == {
        "format": "space",
        "conditions": 4,
        "constraints": 3,
        "left_out": [],
    }
    assert main([*words[:5], str(tmp_path / "model.acts")]) == 2
    assert (
        "expected a name that ends in .txt, .xml, .yaml, .yml, or --format"
        in capsys.readouterr().err
    )
