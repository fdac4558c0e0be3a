"""The forms that are loaded say what tables.json says, or each difference is found: memory images, C header."""

import re
from types import SimpleNamespace

import pytest

import regulator_bundles as bundles
from halpipe.deploy.regulator import codes, forms
from halpipe.deploy.regulator.reading import read_tables


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return bundles.export(tmp_path_factory.mktemp("bundle"), *bundles.system())


def findings(files):
    bundle = bundles.target(files).bundle
    return list(forms.check_forms(bundle, read_tables(bundle)))


def with_form(files, name, change):
    return {**files, name: change(files[name])}


def test_all_forms_agree(files):
    assert findings(files) == []


def test_the_images_of_the_tests_are_those_of_the_exporter(files):
    """The faults that are played on Verilog are written by `forms_of`."""
    images = bundles.forms_of(files)
    assert {name: files[name] for name in images} == images


IMAGES = [f"table/unit{n}.{kind}.memh" for n in range(3) for kind in ("tab", "hdr")]


@pytest.mark.parametrize("name", [*IMAGES, forms.HEADER])
def test_a_missing_form_is_found(files, name):
    (finding,) = findings({key: data for key, data in files.items() if key != name})
    assert finding.code == codes.FORMS_DIFFER.id
    assert finding.at.file == f"cfg/{name}"


@pytest.mark.slow
@pytest.mark.parametrize("name", IMAGES)
def test_every_digit_of_an_image_counts(files, name):
    data = files[name]
    for place, digit in enumerate(data):
        if digit != ord("\n"):
            other = b"1" if digit == ord("0") else b"0"
            (finding,) = findings(with_form(files, name, lambda d, p=place, o=other: d[:p] + o + d[p + 1 :]))
            assert finding.code == codes.FORMS_DIFFER.id
            assert finding.at.line == data.count(b"\n", 0, place) + 1


@pytest.mark.parametrize("change", [lambda d: d[: d.rindex(b"\n", 0, -1) + 1], lambda d: d + d.splitlines()[0] + b"\n"])
def test_lines_too_few_or_too_many(files, change):
    (finding,) = findings(with_form(files, IMAGES[0], change))
    assert "lines, tables.json gives" in finding.message


def test_every_number_of_the_header_counts(files):
    text = re.sub(rb"/\*.*?\*/", lambda m: b" " * len(m[0]), files[forms.HEADER], flags=re.DOTALL)
    places = [m.span(1) for m in re.finditer(rb"\b(\d+)u\b", text)]
    assert len(places) > 50
    for start, end in places:
        number = str(int(files[forms.HEADER][start:end]) + 1).encode()
        assert findings(with_form(files, forms.HEADER, lambda d, s=start, e=end, n=number: d[:s] + n + d[e:])) != []


def test_the_header_names_its_schedule(files):
    digest = re.search(rb'BW_SCHEDULE_SHA256 "(\w+)"', files[forms.HEADER])[1]
    (finding,) = findings(with_form(files, forms.HEADER, lambda data: data.replace(digest, b"0" * 64)))
    assert finding.code == codes.OTHER_SCHEDULE.id


def with_depth(files, entries):
    return files | {"platform.yaml": files["platform.yaml"] + b"table: {depth: %d}\n" % entries}


def test_a_unit_may_fill_its_table_with_the_terminator_and_no_more(files):
    used = max(files[name].count(b"\n") for name in IMAGES if ".tab." in name)
    assert findings(with_depth(files, used)) == []
    (finding,) = findings(with_depth(files, used - 1))
    assert finding.code == codes.TOO_DEEP.id
    assert finding.at.file in {f"cfg/{name}" for name in IMAGES if files[name].count(b"\n") == used}


@pytest.mark.parametrize(("count", "lines"), [(1, 16), (15, 16), (16, 32), (31, 32), (32, 64), (255, 256), (256, 256)])
def test_a_header_image_has_a_line_that_no_table_has_as_far_as_there_are_addresses(count, lines):
    assert forms.header_lines(SimpleNamespace(tables=range(count))) == lines


def test_a_switch_between_modes_that_have_no_table_is_none_of_the_header(files):
    assert b"bw_switches" in files[forms.HEADER]
    renamed = bundles.changed(files, lambda data: data["switches"][0].update({"from": "none"}))
    (found,) = findings(renamed)
    assert found.message.endswith("value 0 is 0, it must be unknown")


def test_what_differs_is_stated_with_both_values(files):
    """Of a line of an image 40 characters at most; tables and values of the header under their numbers."""
    (line,) = findings(with_form(files, IMAGES[0], lambda data: b"x" * 50 + data[data.index(b"\n") :]))
    assert line.message == f'is "{"x" * 40}", tables.json gives {files[IMAGES[0]].decode().splitlines()[0]}'
    text = files[forms.HEADER].decode()
    body = re.search(r"bw_entries_1\[[^]]*\] = \{(.*?)\};", text, re.DOTALL)
    values = re.findall(r"\b\d+(?=u\b)", body[1])
    place = body.start(1) + re.search(r"\d+u\b\D+(\d+)u\b", body[1]).start(1)

    def said(header):
        return [found.message for found in findings({**files, forms.HEADER: header.encode()})]

    other = text[:place] + "7" + text[place:]
    assert said(other) == [
        f"bw_entries_1 is not what tables.json gives: value 1 is 7{values[1]}, it must be {values[1]}"
    ]
    longer = text[: body.end(1)] + ", 5u" + text[body.end(1) :]
    count = f"it has {len(values) + 1} values, it must have {len(values)}"
    assert said(longer) == [f"bw_entries_1 is not what tables.json gives: {count}"]
    assert said(text.replace("bw_entries_1[", "bw_others_1[")) == [
        "bw_entries_1 is not what tables.json gives: it is missing"
    ]
    (named,) = said(re.sub(r"#define BW_TABLE_\w+ +1u", "", text))
    assert named == "names tables 0, 2; tables.json has 0 to 2"
