"""Claims about imports: tables and foreign recordings arrive in SI units on a uniform grid."""

from __future__ import annotations

import gzip
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ldt_core.base.errors import BadInput, OptionError, RecordingError
from ldt_core.base.units import UNITS, parse_field, propose_fields
from ldt_core.cli import invoke
from ldt_core.cli.import_file import command
from ldt_core.cli.info import command as info
from ldt_core.recording.bag import experiments
from ldt_core.recording.importers import import_file
from ldt_core.recording.messages import typestore
from ldt_core.recording.writer import BagWriter
from ldt_core.segmenter.resampling import Series, resample


def table(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_bytes(text.encode(encoding))
    return path


def rows(time, *columns, header="t,u,n", delimiter=",") -> str:
    body = [
        delimiter.join(f"{x!r}" for x in map(float, row))
        for row in zip(time, *columns, strict=True)
    ]
    return "\n".join([header, *body]) + "\n"


TIME = np.arange(20) / 10
VOLTS = np.where(TIME < 1, 3.0, 6.0)
SPEED = np.sin(TIME)
PLAIN = rows(TIME, VOLTS, SPEED)


def load(path, **options):
    return import_file(path, **{"voltage": "u", "speed": "n", "time": "t", **options})


def check_plain(imported, count=20):
    (one,) = imported.experiments
    assert one.period == pytest.approx(0.1, rel=1e-12)
    assert one.voltage.tolist() == VOLTS[:count].tolist()
    assert one.speed.tolist() == SPEED[:count].tolist()


def test_a_uniform_table_arrives_value_for_value(tmp_path):
    """No resampling where none is needed; numbers, period and start as written."""
    imported = load(table(tmp_path / "x.csv", PLAIN))
    check_plain(imported)
    assert imported.experiments[0].start == 0
    assert not any("resampled" in note for note in imported.notes)


LOOKS = {
    "semicolons, decimal commas": lambda: PLAIN.replace(",", ";").replace(".", ","),
    "tabs": lambda: PLAIN.replace(",", "\t"),
    "blanks": lambda: PLAIN.replace(",", "   "),
    "bars": lambda: PLAIN.replace(",", " | "),
    "quoted decimal commas": lambda: "\n".join(
        ",".join(f'"{cell}"'.replace(".", ",") for cell in line.split(","))
        for line in PLAIN.splitlines()
    ),
    "byte-order mark": lambda: "\ufeff" + PLAIN,
    "Windows line ends": lambda: PLAIN.replace("\n", "\r\n"),
    "comments and blank lines": lambda: (
        "# made by hand\n\n" + PLAIN.replace("\n0.5", "\n% x\n\n0.5")
    ),
    "header as a comment": lambda: "# " + PLAIN,
    "row of units": lambda: PLAIN.replace("t,u,n\n", "t,u,n\ns,V,rad/s\n"),
    "rows of units and of short names": lambda: PLAIN.replace(
        "t,u,n\n", "t,u,n\ns,V,rad/s\nx,y,z\n"
    ),
    "rows of short names and of units": lambda: PLAIN.replace(
        "t,u,n\n", "t,u,n\nx,y,z\n[s],[V],[rad/s]\n"
    ),
    "no line end at the end": lambda: PLAIN.rstrip(),
    "spaces after commas": lambda: PLAIN.replace(",", ", "),
    "trailing delimiters": lambda: PLAIN.replace("\n", ",\n"),
}


@pytest.mark.parametrize("look", LOOKS)
def test_tables_of_any_look_give_the_same_numbers(tmp_path, look):
    """What loggers and spreadsheets write."""
    check_plain(load(table(tmp_path / "x.csv", LOOKS[look]())))


def test_a_gzip_file_and_utf_16_are_read(tmp_path):
    """The content decides, not the name."""
    (tmp_path / "x.csv").write_bytes(gzip.compress(PLAIN.encode()))
    check_plain(load(tmp_path / "x.csv"))
    check_plain(load(table(tmp_path / "y.csv", PLAIN, "utf-16")))


def test_columns_go_by_name_with_spaces_and_colons_or_by_number(tmp_path):
    """A header wins over the number; a whole name wins over a unit."""
    text = PLAIN.replace("t,u,n", '"time [s]",motor: u,2')
    path = table(tmp_path / "x.csv", text)
    check_plain(import_file(path, voltage="motor: u", speed="2", time="time [s]"))
    check_plain(import_file(path, voltage="motor: u", speed="3", time="1:s"))
    bare = table(tmp_path / "y.csv", PLAIN.partition("\n")[2])
    check_plain(import_file(bare, voltage="2", speed="3", time="1"))


@pytest.mark.parametrize("zone", ["", "Z", "+01:00"])
def test_dates_are_times(tmp_path, zone):
    """What a logger writes in ISO 8601; as milliseconds, or in another column, it is refused."""
    cells = [f"2026-03-01T08:00:0{t:.3f}{zone}" for t in TIME]
    lines = [f"{c},{u},{n}" for c, u, n in zip(cells, VOLTS, SPEED, strict=True)]
    path = table(tmp_path / "x.csv", "\n".join(["t,u,n", *lines]) + "\n")
    (one,) = load(path).experiments
    assert one.period == pytest.approx(0.1, rel=1e-6)
    assert one.start == 1772352000 - 3600 * (zone == "+01:00")
    for wrong in ({"time": "t:ms"}, {"time": None, "current": "t", "sample_period": 0.1}):
        with pytest.raises(RecordingError, match="column 't': expected a finite number"):
            load(path, **wrong)


def dated(folder: Path, form: str, head: str = "t;u;n\n") -> Path:
    lines = [f"{form.format(t)};{u};{n}\n" for t, u, n in zip(TIME, VOLTS, SPEED, strict=True)]
    return table(folder / "x.csv", head + "".join(lines).replace(".", ",").replace("_", "."))


def test_dates_with_dots_are_times(tmp_path):
    """As German loggers write them: the day comes first. Also where no line names the columns."""
    form = "2_3_2026 8:00:0{:.3f}"
    for name, head in (("t", "t;u;n\n"), ("1", "")):
        path = dated(tmp_path, form, head)
        (one,) = load(path, time=name, voltage="2", speed="3").experiments
        assert one.start == 1772438400
        assert one.voltage.tolist() == VOLTS.tolist()


@pytest.mark.parametrize(
    "form", ["02_03_26 08:00:0{:.3f}", "03/02/2026 08:00:0{:.3f}", "32_03_2026 08:00:0{:.3f}"]
)
def test_a_date_that_cannot_be_told_says_how_dates_are_read(tmp_path, form):
    """Not that its decimals are wrong."""
    told = "line 2, column 't': expected a finite number, or a date such as 2026-03-31T08:00:00.5"
    with pytest.raises(RecordingError, match=re.escape(told)):
        load(dated(tmp_path, form))


def test_a_date_is_told_to_have_no_unit(tmp_path):
    """Which it was asked for once."""
    with pytest.raises(RecordingError, match="a date is taken for --time alone, and has no unit"):
        load(dated(tmp_path, "02_03_2026 08:00:0{:.3f}"), time="t:ms")


def test_a_table_without_time_takes_the_sample_period(tmp_path):
    """One of the two is needed."""
    path = table(tmp_path / "x.csv", PLAIN)
    check_plain(load(path, time=None, sample_period=0.1))
    with pytest.raises(OptionError, match="--sample-period"):
        load(path, time=None)


@pytest.mark.parametrize(
    ("unit", "quantity", "value"),
    [
        ("rpm", "speed", 2 * math.pi / 60),
        ("krpm", "speed", 2000 * math.pi / 60),
        ("Hz", "speed", 2 * math.pi),
        ("deg/s", "speed", math.pi / 180),
        ("mV", "voltage", 1e-3),
        ("mA", "current", 1e-3),
        ("ms", "time", 1e-3),
        ("us", "time", 1e-6),
        ("μs", "time", 1e-6),
    ],
)
def test_units_are_converted_to_si(unit, quantity, value):
    """One of each in SI units; a speed in Hz is revolutions per second."""
    assert parse_field(f"a:{unit}", quantity).factor == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("rpm", "speed", "rpm"),
        ("Speed (RPM)", "speed", "RPM"),
        ("n [1/min]", "speed", "1/min"),
        ("time_ms", "time", "ms"),
        ("voltage_mV", "voltage", "mV"),
    ],
)
def test_a_name_that_says_another_unit_is_not_taken_for_si(name, quantity, unit):
    """The sentence has both ways to say which it is; either is taken."""
    with pytest.raises(OptionError, match=re.escape(f"{name}:{unit} or {name}:")):
        parse_field(name, quantity)
    assert parse_field(f"{name}:{unit}", quantity).factor == UNITS[quantity][unit]
    assert parse_field(f"{name}:{next(iter(UNITS[quantity]))}", quantity).factor == 1


@pytest.mark.parametrize(
    ("name", "quantity", "instead"),
    [
        ("v_mm_s", "speed", "v_mm_s:NUMBER, the motor's rad/s at 1 mm/s"),
        ("carriage [m/s]", "speed", "carriage [m/s]:NUMBER"),
        ("phi_deg", "speed", "--position phi_deg:UNIT"),
        ("pos_m", "speed", "--position pos_m:UNIT"),
        ("/joint_states.position[0]", "speed", "/joint_states.position[0]:UNIT"),
        ("cmd_pct", "voltage", "cmd_pct:NUMBER, the V at 1 pct"),
    ],
)
def test_a_carriage_a_position_and_a_share_are_no_speed_and_no_voltage(name, quantity, instead):
    """Each was taken for rad/s or V without a word; whoever says the unit is believed."""
    with pytest.raises(OptionError, match=re.escape(instead)):
        parse_field(name, quantity)
    assert parse_field(f"{name}:{next(iter(UNITS[quantity]))}", quantity).factor == 1


@pytest.mark.parametrize(("unit", "quantity"), [("mm/s", "speed"), ("%", "voltage")])
def test_a_unit_of_another_quantity_says_what_to_give(unit, quantity):
    """The nearest name was proposed: mrad/s for mm/s."""
    with pytest.raises(OptionError, match=f"x:NUMBER, the .* at 1 {unit}"):
        parse_field(f"x:{unit}", quantity)


def test_a_number_in_place_of_a_unit_is_what_one_is_in_si(tmp_path):
    """For a screw, a gear or a share of the supply; it is a unit of which nothing is doubted."""
    loaded = load(table(tmp_path / "x.csv", PLAIN), speed="n:628.3", voltage="u:-0.48")
    assert loaded.experiments[0].speed == pytest.approx(628.3 * SPEED, rel=1e-12)
    assert loaded.experiments[0].voltage == pytest.approx(-0.48 * VOLTS, rel=1e-12)
    assert "speed from 'n' in 628.3 rad/s" in " ".join(loaded.notes)
    assert not loaded.doubts
    with pytest.raises(OptionError, match="got '0'"):
        parse_field("n:0", "speed")


def test_no_carriage_is_proposed_as_the_time():
    """`carriage_m_s` ends in `_s`, and was the time beside a column t."""
    assert propose_fields({"t": "", "u": "", "carriage_m_s": ""})["time"] == "t:UNIT"


@pytest.mark.parametrize(
    "name", ["speed_rad_s", "omega [rad/s]", "alarms", "t_s", "w", "trpm", "n_m"]
)
def test_a_name_that_says_si_or_nothing_is_si(name):
    """A word that merely ends like a unit is none."""
    assert parse_field(name, "speed" if "t_s" not in name else "time").factor == 1


def test_a_speed_in_a_name_is_not_taken_for_seconds():
    """`speed_rad_s` ends in `_s`, and is no time."""
    found = propose_fields({"timestamp": "", "u_mV": "", "speed_rad_s": ""})
    assert found == {"time": "timestamp", "voltage": "u_mV:mV", "speed": "speed_rad_s"}


@pytest.mark.parametrize(
    ("said", "ways"),
    [("[rpm]", "n:rpm or n:rad/s"), ("Upm", "n:Upm or n:rad/s"), ("Umdr", "n:rad/s, since")],
)
def test_a_unit_below_a_name_is_not_taken_for_si(tmp_path, said, ways):
    """As one in the name: asked for, known or not; a unit that is given is believed."""
    path = table(tmp_path / "x.csv", PLAIN.replace("t,u,n\n", f"t,u,n\n(s),V,{said}\n"))
    with pytest.raises(OptionError, match=re.escape(ways)):
        load(path)
    with pytest.raises(OptionError, match=re.escape(ways.replace("n:", "3:"))):
        load(path, speed="3")
    check_plain(load(path, speed="n:rad/s"))


def test_a_row_of_words_that_are_no_units_is_data(tmp_path):
    """Values that are lacking, or a number among words; a dimensionless column's 1 is no number."""
    begin, _, rest = PLAIN.partition("\n")
    lacking = table(tmp_path / "x.csv", f"{begin}\nnull,,null\n{rest}")
    assert "1 row of" in " ".join(load(lacking).notes)
    with pytest.raises(RecordingError, match=r"line 2, column 'n'.*finite number"):
        load(table(tmp_path / "y.csv", f"{begin}\n0.0,1.5,bad\n{rest}"))
    counted = "\n".join(f"{k},{line}" for k, line in enumerate(rest.splitlines()))
    check_plain(load(table(tmp_path / "z.csv", f"k,{begin}\n1,s,V,rad/s\n{counted}\n")))


def test_columns_whose_names_say_the_opposite_are_told(tmp_path):
    """Voltage from the speed's column and the reverse; the right way round says nothing."""
    path = table(tmp_path / "x.csv", rows(TIME, VOLTS, SPEED))
    said = "look swapped; by their names it is --voltage u:UNIT --speed n:UNIT"
    assert said in " ".join(load(path, voltage="n", speed="u:rad/s").notes)
    assert "swapped" not in " ".join(load(path).notes)


@pytest.mark.parametrize("option", ["speed", "current", "time"])
def test_a_column_is_one_quantity(tmp_path, option):
    """Speed that is the voltage makes a motor that follows without delay."""
    path = table(tmp_path / "x.csv", rows(TIME, VOLTS, SPEED))
    with pytest.raises(OptionError, match=f"--{option}: expected another field than that of the v"):
        load(path, **{option: "u"})


@pytest.mark.parametrize("cell", ["1_0", "1_0.5", "1e1_0"])
def test_what_python_alone_takes_for_a_number_is_none(tmp_path, cell):
    """It would be ten times as much as a person reads, or nothing at all."""
    path = table(tmp_path / "x.csv", PLAIN.replace("\n0.3,3.0", f"\n0.3,{cell}"))
    with pytest.raises(RecordingError, match="line 5, column 'u': expected a finite number"):
        load(path)


def test_a_size_that_speaks_for_another_unit_is_told(tmp_path):
    """1500 of a column without a unit, and rows 10 apart; a unit that is given is believed."""
    path = table(tmp_path / "x.csv", rows(TIME * 100, VOLTS, 1500 + SPEED))
    notes = " ".join(load(path).notes)
    assert "if they are rpm: --speed n:rpm" in notes
    assert "if they are ms: --time t:ms" in notes
    amps = table(tmp_path / "i.csv", rows(TIME, VOLTS, SPEED, 1500 * SPEED, header="t,u,n,i"))
    assert "if they are mA: --current i:mA" in " ".join(load(amps, current="i").notes)
    micro = table(tmp_path / "us.csv", rows(TIME * 1e6, VOLTS, SPEED))
    assert "if they are us: --time t:us" in " ".join(load(micro).notes)
    assert "if they are" not in " ".join(load(path, speed="n:rpm", time="t:ms").notes)
    assert "if they are" not in " ".join(load(path, speed="n:rad/s", time="t:s").notes)


@pytest.mark.parametrize(
    ("speeds", "step"),
    [(1500, "if a unit is another"), (0, "if a unit is another"), (100, "a machine file")],
)
def test_where_a_unit_is_doubted_the_next_step_is_to_import_again(tmp_path, capsys, speeds, step):
    """To identify a motor from it comes second."""
    path = table(tmp_path / "x.csv", rows(TIME, VOLTS, speeds + SPEED))
    fields = ["--voltage", "u", "--speed", "n", "--time", "t", "--out", str(tmp_path / "bag")]
    assert invoke(command, [str(path), *fields]) == 0
    steps = [line for line in capsys.readouterr().out.splitlines() if line.startswith("Next, ")]
    assert [line.startswith(f"Next, {step}") for line in steps] == [True]


def test_a_speed_that_never_changes_is_asked_about(tmp_path):
    """A pump's valve beside its impeller was taken without a word."""
    asked = "the speed is 0 rad/s throughout: is it the right field?"
    assert asked in load(table(tmp_path / "x.csv", rows(TIME, VOLTS, 0 * SPEED))).notes
    assert "throughout" not in " ".join(load(table(tmp_path / "y.csv", PLAIN)).notes)


def test_an_unknown_unit_is_refused_with_the_list(tmp_path):
    """Also one of another quantity."""
    path = table(tmp_path / "x.csv", PLAIN)
    with pytest.raises(OptionError, match="did you mean 'krpm'") as caught:
        load(path, speed="n:kprm")
    assert all(repr(unit) in str(caught.value) for unit in UNITS["speed"])
    with pytest.raises(OptionError, match="--voltage, unit"):
        load(path, voltage="u:rpm")


def test_all_channels_are_converted(tmp_path):
    """rpm, mV, mA and ms in one import."""
    text = rows(TIME * 1000, VOLTS * 1000, SPEED, VOLTS, header="t,u,n,i")
    (one,) = load(
        table(tmp_path / "x.csv", text), time="t:ms", voltage="u:mV", speed="n:rpm", current="i:mA"
    ).experiments
    assert one.period == pytest.approx(0.1)
    assert one.voltage == pytest.approx(VOLTS)
    assert one.speed == pytest.approx(SPEED * 2 * math.pi / 60)
    assert one.current == pytest.approx(VOLTS / 1000)


BROKEN = {
    "a word": (PLAIN.replace("\n0.3,3.0", "\n0.3,off"), "line 5, column 'u'"),
    "three empty cells of twenty": (PLAIN.replace(",3.0,", ",,", 3), "line 2"),
    "empty cells alone": ("t,u,n\n1,,2\n2,,3\n", "2 rows of 2"),
    "infinity": (PLAIN.replace("\n0.3,3.0", "\n0.3,1e999"), "line 5, column 'u'"),
    "beyond floating point": (PLAIN.replace("\n0.3,3.0", "\n0.3,1e308"), "at most 1e+30"),
    "an open quote": (PLAIN.replace("\n0.3,", '\n"0.3,'), "line 5: expected 3 cells, and each"),
    "a short row": (PLAIN.replace("\n0.2,", "\n0.2\n0.25,"), "line 4"),
    "time repeated": (PLAIN.replace("\n0.2,", "\n0.1,"), "line 4"),
    "time backwards": (PLAIN.replace("\n0.2,", "\n0.05,"), "line 4"),
    "comma and point": (PLAIN.replace(",", ";").replace("0.1;3.0", "0,1;3.0"), "decimal comma"),
    "no rows": ("t,u,n\n", "none"),
    "one row": ("t,u,n\n1,2,3\n", "samples or more"),
    "nothing": ("", "empty"),
    "comments alone": ("# a\n# b\n", "empty"),
    "no such column": (PLAIN.replace("t,u,n", "t,volts,n"), "'volts'"),
    "column twice": (PLAIN.replace("t,u,n", "t,u,u"), "several"),
}


@pytest.mark.parametrize("cell", ["", "null", " NULL"])
def test_a_row_that_lacks_a_value_is_left_out_and_said(tmp_path, cell):
    """As if the logger had not written it; without times nothing would say that it is missing."""
    text = PLAIN.replace("\n0.3,3.0", f"\n0.3,{cell}")
    without = "".join(line for line in PLAIN.splitlines(True) if not line.startswith("0.3,"))
    left_out = load(table(tmp_path / "x.csv", text))
    expected = load(table(tmp_path / "y.csv", without))
    assert "1 row of 20 left out for a value that they lack, the first in line 5" in left_out.notes
    assert [e.speed.tolist() for e in left_out.experiments] == [
        e.speed.tolist() for e in expected.experiments
    ]
    with pytest.raises(RecordingError, match="line 5, column 'u'"):
        load(tmp_path / "x.csv", time=None, sample_period=0.1)


@pytest.mark.parametrize("fault", BROKEN)
def test_a_broken_table_is_refused_with_the_line(tmp_path, fault):
    """File, line or column, what was expected and what came."""
    text, named = BROKEN[fault]
    with pytest.raises(RecordingError) as caught:
        load(table(tmp_path / "x.csv", text))
    assert named in str(caught.value)
    assert str(tmp_path / "x.csv") in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "data",
    [b"PK\x03\x04\0\0\0\0binary", gzip.compress(PLAIN.encode())[:-30], b"\x1f\x8b\x08" + bytes(40)],
    ids=["a spreadsheet", "a cut gzip file", "a broken gzip file"],
)
def test_a_file_that_is_no_table_is_refused_in_a_sentence(tmp_path, data):
    """The wrong file on the command line is common."""
    (tmp_path / "x.csv").write_bytes(data)
    with pytest.raises(RecordingError):
        load(tmp_path / "x.csv")


def test_a_missing_file_is_refused(tmp_path):
    """As everywhere; also a recording, which is not taken for a table that lacks its times."""
    with pytest.raises(RecordingError, match="No such file"):
        load(tmp_path / "x.csv")
    with pytest.raises(RecordingError, match="No such file"):
        import_file(tmp_path / "bag", voltage="/motor.data", speed="/joint_states.velocity[0]")


@settings(max_examples=200)
@given(st.text(max_size=60) | st.text('0123456789.,;-e\t\n\r "#%|abn', max_size=80))
def test_any_text_is_a_table_or_a_sentence(tmp_path_factory, text):
    """Never another exception."""
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        imported = import_file(path, voltage="1", speed="1", sample_period=0.1)
    except BadInput:
        return
    assert imported.experiments


@pytest.mark.parametrize("option", ["sample_period", "length"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf, 1e308, 5e-324])
def test_an_impossible_period_or_length_is_refused(tmp_path, option, value):
    """Seconds above 0."""
    with pytest.raises(OptionError, match="seconds above 0"):
        load(table(tmp_path / "x.csv", PLAIN), **{option: value})


def test_times_that_no_clock_tells_apart_are_refused(tmp_path):
    """1e-300 s from row to row, at which nothing can be computed."""
    text = "t,u,n\n" + "".join(f"{k}e-300,1,{k}\n" for k in range(20))
    with pytest.raises(RecordingError, match="times 1e-09 s apart or more, got 1e-300 s"):
        load(table(tmp_path / "x.csv", text))


def test_a_period_in_the_wrong_unit_is_refused_before_it_fills_the_memory(tmp_path):
    """1e-12 s over 2 s."""
    with pytest.raises(OptionError, match="--sample-period"):
        load(table(tmp_path / "x.csv", PLAIN), sample_period=1e-12)


def test_experiments_have_equal_length_and_the_remainder_is_reported(tmp_path):
    """20 samples in experiments of 0.6 s: three of six samples, two dropped."""
    imported = load(table(tmp_path / "x.csv", PLAIN), length=0.6)
    assert [(e.number, len(e)) for e in imported.experiments] == [(1, 6), (2, 6), (3, 6)]
    assert [e.start for e in imported.experiments] == pytest.approx([0, 0.6, 1.2])
    assert imported.experiments[1].speed.tolist() == SPEED[6:12].tolist()
    assert any("2 samples at ends" in note for note in imported.notes)


def test_a_length_beyond_the_data_is_refused(tmp_path):
    """The sentence says how much there is."""
    with pytest.raises(RecordingError, match="2 s at most"):
        load(table(tmp_path / "x.csv", PLAIN), length=60)
    with pytest.raises(OptionError, match="--length"):
        load(table(tmp_path / "x.csv", PLAIN), length=0.1)


def test_a_gap_splits_experiments_and_is_reported_with_its_line(tmp_path):
    """10 samples, a pause of 5 s, 10 samples: no experiment reaches over the pause."""
    time = np.where(TIME < 1, TIME, TIME + 5)
    imported = load(table(tmp_path / "x.csv", rows(time, VOLTS, SPEED)))
    assert [len(e) for e in imported.experiments] == [10, 10]
    assert imported.experiments[1].start == pytest.approx(6)
    assert any("1 gap" in note and "line 11" in note for note in imported.notes)
    assert [len(e) for e in load(tmp_path / "x.csv", length=0.4).experiments] == [4, 4, 4, 4]


def test_lost_samples_are_bridged_by_interpolation(tmp_path):
    """Two rows of a line missing: the straight line comes back."""
    keep = np.ones(20, bool)
    keep[[5, 6]] = False
    text = rows(TIME[keep], VOLTS[keep], 3 * TIME[keep])
    (one,) = load(table(tmp_path / "x.csv", text)).experiments
    assert one.speed == pytest.approx(3 * TIME, abs=1e-12)
    assert one.voltage.tolist() == VOLTS.tolist()


@pytest.mark.parametrize("began", [0.0, 1.7e9 + 123.456])
def test_a_lost_row_costs_no_run_whatever_the_clock_says(tmp_path, began):
    """Runs of 1500 rows with pauses, one row of each lost: every run gives its experiment."""
    runs = np.concatenate([37.37 * k + np.arange(1500) * 0.004 for k in range(8)])
    time = np.delete(began + runs, 700 + 1500 * np.arange(8)).round(4)
    path = table(tmp_path / "x.csv", rows(time, 0 * time, 0 * time))
    assert [len(e) for e in load(path, length=6).experiments] == [1500] * 8


def test_jittered_samples_are_put_on_a_grid(tmp_path):
    """A ramp sampled with 20 % jitter is the ramp on the grid; a step keeps its volt-seconds."""
    time = np.arange(200) / 10 + np.random.default_rng(0).uniform(-0.02, 0.02, 200)
    time -= time[0]
    voltage = np.where(time < 10, 2.0, 8.0)
    imported = load(table(tmp_path / "x.csv", rows(time, voltage, 5 * time)))
    (one,) = imported.experiments
    assert one.period == pytest.approx(0.1, rel=5e-3)
    assert one.speed == pytest.approx(5 * (one.start + one.time), abs=1e-9)
    step = int(np.argmax(one.voltage > 2.0))
    assert set(one.voltage[:step]) == {2.0}
    assert set(one.voltage[step + 1 :]) == {8.0}
    begun = one.start + one.time[step]
    spent = 2.0 * (time[voltage > 2.0][0] - begun) + 8.0 * (begun + 0.1 - time[voltage > 2.0][0])
    assert one.voltage[step] == pytest.approx(spent / 0.1, rel=0.01)
    assert any("resampled" in note for note in imported.notes)


def test_downsampling_does_not_fold_fast_noise_into_the_result(tmp_path):
    """49 Hz at 1000 Hz taken down to 50 Hz would be seen as 1 Hz; the mean takes it away."""
    time = np.arange(10_000) / 1000
    slow, fast = np.sin(2 * np.pi * 0.2 * time), np.sin(2 * np.pi * 49 * time)
    voltage = np.where(np.arange(10_000) % 20 < 5, 4.0, 0.0)
    text = rows(time, voltage, slow + fast)
    (one,) = load(table(tmp_path / "x.csv", text), sample_period=0.02).experiments
    wanted = np.sin(2 * np.pi * 0.2 * one.time)
    inside = slice(2, -2)
    assert np.abs(one.speed - wanted)[inside].max() < 0.05
    assert one.voltage[inside] == pytest.approx(1.0)


def test_a_time_before_zero_is_moved_so_that_it_can_be_recorded(tmp_path):
    """Oscilloscopes count from the trigger."""
    imported = load(table(tmp_path / "x.csv", rows(TIME - 1, VOLTS, SPEED)))
    check_plain(imported)
    assert imported.experiments[0].start == 0
    assert any("moved by 1 s" in note for note in imported.notes)


@settings(max_examples=60)
@given(
    st.lists(st.floats(0.5, 1.5), min_size=3, max_size=40),
    st.floats(-100, 100),
    st.floats(-100, 100),
    st.floats(0.2, 5),
)
def test_resampling_keeps_straight_lines_and_constants(steps, slope, offset, period):
    """At any times, up or down: a line is its own interpolation and, inside, its own mean."""
    time = np.concatenate(([0.0], np.cumsum(steps)))
    grid = np.arange(0, time[-1], period)
    line = Series(time, offset + slope * time, str)
    got = resample(line, grid, period, held=False)
    inside = (grid - period / 2 >= 0) & (grid + period / 2 <= time[-1])
    assert got[inside] == pytest.approx((offset + slope * grid)[inside], abs=1e-8)
    constant = Series(time, np.full(time.size, offset), str)
    assert resample(constant, grid, period, held=True) == pytest.approx(offset, abs=1e-8)


def test_imported_experiments_survive_the_recording(tmp_path):
    """import → bag → read: the same numbers."""
    imported = load(table(tmp_path / "x.csv", PLAIN), length=0.5)
    with BagWriter(tmp_path / "bag", "motor") as bag:
        for one in imported.experiments:
            bag.write("experiment", one, one.end)
    back = experiments(tmp_path / "bag").experiments
    assert [e.speed.tolist() for e in back] == [e.speed.tolist() for e in imported.experiments]


def foreign(
    path: Path,
    voltage_times=TIME,
    stamped: bool = True,
    first: bool = True,
    positions: bool = False,
) -> Path:
    """JointState (velocity or position of two joints) and Float64 voltages, by rosbags."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    types = typestore().types
    joint, number = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64"
    header, stamp = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    messages = []
    for t, speed in zip(TIME, SPEED, strict=True):
        at = 1_000_000_000 + round(t * 1e9)
        head = header(stamp=stamp(sec=at // 10**9, nanosec=at % 10**9), frame_id="")
        if not (stamped and (first or t > 0)):
            head = header(stamp=stamp(sec=0, nanosec=0), frame_id="")
        state = types[joint](
            header=head,
            name=["a", "b"],
            position=np.array([0.0, 1 - np.cos(t)]) if positions else np.zeros(2),
            velocity=np.zeros(0) if positions else np.array([0.0, speed]),
            effort=np.array([]),
        )
        messages.append((at + (0 if not stamped else 5_000_000), joint, state))
    for t in voltage_times:
        at = 1_000_000_000 + round(t * 1e9)
        messages.append((at, number, types[number](data=3.0 if t < 1 else 6.0)))
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {
            joint: writer.add_connection("/joint_states", joint, typestore=typestore()),
            number: writer.add_connection("/drive/voltage", number, typestore=typestore()),
        }
        for at, kind, message in sorted(messages, key=lambda m: m[0]):
            writer.write(topics[kind], at, typestore().serialize_cdr(message, kind))
    return path


def test_a_foreign_recording_is_imported_by_topic_field_and_index(tmp_path):
    """Two topics with their own times; the header's stamp counts, not the reception."""
    path = foreign(tmp_path / "bag")
    imported = import_file(path, voltage="/drive/voltage.data", speed="/joint_states.velocity[1]")
    check_plain(imported)
    assert imported.experiments[0].start == pytest.approx(1)
    assert any("those of the voltage reception times; a delay" in n for n in imported.notes)
    (one,) = import_file(
        next(path.glob("*.mcap")),
        voltage="/drive/voltage.data:mV",
        speed="/joint_states.velocity[1]:rpm",
    ).experiments
    assert one.speed == pytest.approx(SPEED * 2 * math.pi / 60)
    assert one.voltage == pytest.approx(VOLTS / 1000)


@pytest.mark.parametrize(
    ("name", "factor", "column", "given"),
    [
        ("Timestamp", 1e3, "'Timestamp' (100 from row to row: ms?)", "Timestamp:UNIT"),
        ("time", 1e6, "'time' (100000 from row to row: us?)", "time:UNIT"),
        ("t", 1e3, "'t' (100 from row to row: ms?)", "t:UNIT"),
        ("time", 1, "'time'", "time"),
        ("time_s", 1e3, "'time_s'", "time_s"),
    ],
)
def test_times_whose_steps_are_hardly_seconds_are_asked_for(
    name, factor, column, given, tmp_path, capsys
):
    """Seconds were proposed for a column Timestamp that rises by 10 ms; a name's unit is kept."""
    text = rows(TIME * factor, VOLTS, SPEED, header=f"{name},u,n")
    assert invoke(info, [str(table(tmp_path / "x.csv", text))]) == 0
    said = capsys.readouterr().out
    assert f"columns {column}, 'u', 'n'" in said
    assert f"--time {given} --" in said


def test_times_without_a_name_are_asked_for_too(tmp_path, capsys):
    """The only column that rises, by steps of 10."""
    text = rows(TIME * 100, VOLTS, SPEED).split("\n", 1)[1]
    assert invoke(info, [str(table(tmp_path / "x.csv", text))]) == 0
    assert "--time 1:UNIT --out" in capsys.readouterr().out


def test_positions_of_joint_states_without_velocities_are_proposed_and_imported(tmp_path, capsys):
    """A field that nobody fills was left to the reader; the mean of two samples is their speed."""
    path = foreign(tmp_path / "bag", positions=True)
    assert invoke(info, [str(path)]) == 0
    assert "--position /joint_states.position[INDEX]:rad --out" in capsys.readouterr().out
    field = "/joint_states.position[1]:rad"
    (one,) = import_file(path, voltage="/drive/voltage.data", position=field).experiments
    assert one.speed == pytest.approx(np.sin(TIME[:-1] + 0.05), abs=1e-3)
    assert one.start == pytest.approx(1.05)
    assert one.voltage == pytest.approx(np.where(TIME < 0.9, 3, np.where(TIME < 0.99, 4.5, 6))[:-1])


def test_info_says_how_many_more_lengths_of_experiments_there_are(tmp_path, capsys):
    """Of files of four lengths three were told, as if there were no other."""
    text = PLAIN.splitlines(keepends=True)
    files = [str(table(tmp_path / f"{n}.csv", "".join(text[:n]))) for n in (8, 10, 12, 14)]
    bag = str(tmp_path / "bag")
    fields = ["--voltage", "u", "--speed", "n", "--time", "t"]
    assert invoke(command, [*files, *fields, "--out", bag]) == 0
    capsys.readouterr()
    assert invoke(info, [bag]) == 0
    said = capsys.readouterr().out
    assert said.count("samples at") == 3
    assert "of 1 and 1 more\n" in said


def test_a_foreign_recording_says_which_element_is_which_joint_s(tmp_path, capsys):
    """[0] was proposed, whose joint stood still; of two joints the reader chooses."""
    assert invoke(info, [str(foreign(tmp_path / "bag"))]) == 0
    said = capsys.readouterr().out
    assert "position[0] a, position[1] b; velocity[0] a, velocity[1] b\n" in said
    assert "--speed /joint_states.velocity[INDEX] --out" in said


def test_a_voltage_command_holds_until_the_next_one(tmp_path):
    """Sent only when it changes: three messages make twenty samples."""
    path = foreign(tmp_path / "bag", voltage_times=[0.0, 0.5, 1.0])
    imported = import_file(path, voltage="/drive/voltage.data", speed="/joint_states.velocity[1]")
    check_plain(imported)
    assert any("held for up to 0.9 s" in note for note in imported.notes)


def test_samples_before_the_first_voltage_are_left_out(tmp_path):
    """What the machine was driven with is not known there."""
    path = foreign(tmp_path / "bag", voltage_times=[0.5, 1.0])
    (one,) = import_file(
        path, voltage="/drive/voltage.data", speed="/joint_states.velocity[1]"
    ).experiments
    assert one.start == pytest.approx(1.5)
    assert one.speed == pytest.approx(SPEED[5:])
    assert one.voltage.tolist() == VOLTS[5:].tolist()


def test_messages_without_a_stamp_are_timed_by_their_reception(tmp_path):
    """And the note says so."""
    path = foreign(tmp_path / "bag", stamped=False)
    imported = import_file(path, voltage="/drive/voltage.data", speed="/joint_states.velocity[1]")
    check_plain(imported)
    assert "times are reception times" in imported.notes


def test_a_topic_of_which_some_messages_have_a_stamp_is_timed_by_reception(tmp_path):
    """Stamps and receptions in one series would make a jitter that no machine has."""
    path = foreign(tmp_path / "bag", first=False)
    imported = import_file(path, voltage="/drive/voltage.data", speed="/joint_states.velocity[1]")
    assert imported.experiments[0].start == pytest.approx(1.005)
    assert (
        "times are reception times, as not all messages of a topic have a stamp" in imported.notes
    )


def test_a_time_of_the_message_may_be_chosen(tmp_path):
    """With all channels from that topic."""
    path = foreign(tmp_path / "bag")
    (one,) = import_file(
        path,
        voltage="/joint_states.velocity[0]",
        speed="/joint_states.velocity[1]",
        time="/joint_states.header.stamp",
    ).experiments
    assert one.speed.tolist() == SPEED.tolist()
    with pytest.raises(OptionError, match="--time"):
        import_file(
            path,
            voltage="/drive/voltage.data",
            speed="/joint_states.velocity[1]",
            time="/joint_states.header.stamp",
        )


@pytest.mark.parametrize(
    ("speed", "named"),
    [
        ("/joint_state.velocity[1]", "did you mean '/joint_states'"),
        ("/joint_states.velocty[1]", "did you mean 'velocity'"),
        ("/joint_states.velocity[2]", "2 values"),
        ("/joint_states.velocity", "choose one with [index]"),
        ("/joint_states.effort[0]", "0 values"),
        ("/joint_states.name[0]", "a number"),
        ("/joint_states.header.frame_id.x", "'x' of ''"),
        ("/joint_states.__class__", "/topic.field[index]"),
        ("/joint_states", "/topic.field[index]"),
        ("velocity", "/topic.field[index]"),
    ],
)
def test_a_field_that_is_not_there_is_refused_in_a_sentence(tmp_path, speed, named):
    """Topic, field, index: what exists instead."""
    path = foreign(tmp_path / "bag")
    with pytest.raises(BadInput) as caught:
        import_file(path, voltage="/drive/voltage.data", speed=speed)
    assert named in str(caught.value)


def test_the_measured_motor_arrives_in_si_units(measured):
    """100 Hz, 12.21 s, steps from 5 V; the first speed is 1056.02 rpm."""
    path = measured / "rtl_dcmotor" / "open_loop_5_15V.csv"
    (one,) = import_file(path, "voltage_V", "speed_rpm:rpm", time="time_s").experiments
    assert (len(one), one.period, one.voltage[0]) == (1221, 0.01, 5)
    assert one.speed[0] == pytest.approx(1056.02 * 2 * math.pi / 60)


@pytest.mark.slow
def test_half_a_million_rows_are_imported_whole(measured):
    """The motor-generator pair: 500,000 rows in 50 experiments, nothing dropped."""
    path = measured / "motor_generator" / "motor_generator.csv.gz"
    imported = import_file(path, "drive", "speed", sample_period=0.01, length=100)
    assert [len(e) for e in imported.experiments] == [10_000] * 50
    assert imported.experiments[0].speed[0] == -143.8
    assert not any("dropped" in note for note in imported.notes)


# ---- cut by the segmenter


def stepped(path: Path) -> Path:
    """Two seconds at rest, three of a step response, at rest, another; no gap."""
    time = np.arange(1200) / 100
    volts = np.where((time % 6 >= 2) & (time % 6 < 5), 12.0, 0.0)
    speed = np.zeros(time.size)
    for k in range(1, time.size):
        speed[k] = speed[k - 1] + 0.1 * (5 * volts[k - 1] - speed[k - 1])
    return table(path, rows(time, volts, speed))


def test_a_recorded_stream_is_cut_by_trigger(tmp_path):
    """As a running machine's is: from before each edge, of the length from it on."""
    cut = {"cut": "trigger", "trigger_level": 6.0, "pre_trigger": 0.1}
    imported = load(stepped(tmp_path / "x.csv"), length=1.0, cut=cut)
    assert [e.start for e in imported.experiments] == pytest.approx([1.9, 7.9])
    assert [len(e) for e in imported.experiments] == [110, 110]
    assert imported.experiments[0].voltage.tolist() == [0.0] * 10 + [12.0] * 100
    assert "cut by trigger" in imported.notes


def test_a_recorded_stream_is_cut_by_steady_state(tmp_path):
    """Up and down, each until it has settled."""
    cut = {"cut": "steady", "steady_band": 1.0, "steady_time": 0.5}
    imported = load(stepped(tmp_path / "x.csv"), length=5.0, cut=cut)
    assert len(imported.experiments) == 4
    assert all(np.ptp(e.speed[-50:]) <= 1.0 for e in imported.experiments)


def test_a_cut_without_a_length_or_without_an_edge_says_so(tmp_path):
    """One sentence each."""
    file = stepped(tmp_path / "x.csv")
    with pytest.raises(OptionError, match="--length"):
        load(file, cut={"cut": "trigger"})
    with pytest.raises(RecordingError, match="an experiment by trigger"):
        load(file, length=1.0, cut={"cut": "trigger", "trigger_level": 20.0})
