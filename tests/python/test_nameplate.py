"""A nameplate as data sheets write it comes to the parameters of the model, or is refused with what it could
mean.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import pmsm_rs as pm
import pytest
from conftest import Ran
from hypothesis import given
from hypothesis import strategies as st
from pmsm_rs.config.machine_file import MachineFile, read_machine
from pmsm_rs.quantities.compound import EXAMPLES, compound
from pmsm_rs.support.demo import recording_files

Read = Callable[[str], MachineFile]

KRPM = 1e3 * 2.0 * math.pi / 60.0
# Liu, Liu & Cartes (2008), table 1: k_t = 1.629 N m per A rms, k_e = 1.33 V s/rad, four pole pairs.
PSI = 0.19197949109214762


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def call(text: str) -> MachineFile:
        path = tmp_path / "m.toml"
        path.write_text(f"[machine]\n{text}\n")
        return read_machine(path)

    return call


def refusal(read: Read, text: str) -> str:
    with pytest.raises(pm.MachineError) as caught:
        read(text)
    return str(caught.value)


# Worked by hand: the numbers of data sheets with four digits.
SHEETS = {
    "k_t of the paper": ('n_p = 4\nk_t = { value = 1.629, unit = "N·m/A rms" }', {"psi_m": 0.1920}),
    "k_t in Nm/Arms": ('n_p = 4\nk_t = { value = 1.629, unit = "Nm/Arms" }', {"psi_m": 0.1920}),
    "k_t per peak": ('n_p = 4\nk_t = { value = 1.152, unit = "N m/A peak" }', {"psi_m": 0.1920}),
    # 100 oz in = 0.70616 N m
    "k_t in ounces": ('n_p = 4\nk_t = { value = 100, unit = "oz-in/Apk" }', {"psi_m": 0.1177}),
    "k_e of the paper": (
        'n_p = 4\nk_e = { value = 1.33, unit = "V s/rad line-to-line peak" }',
        {"psi_m": 0.1920},
    ),
    # a servo motor with k_t = 1.62 N m/A rms has k_e = 98 Vrms/krpm: 98/104.72 = 0.9358 V s
    "k_e of servo motors": ('n_p = 4\nk_e = { value = 98, unit = "Vrms/krpm L-L" }', {"psi_m": 0.1910}),
    "k_e per 1000 1/min": ('n_p = 4\nk_e = { value = 98, unit = "V/1000 min-1 L-L rms" }', {"psi_m": 0.1910}),
    "k_e of a phase": ('n_p = 4\nk_e = { value = 80.42, unit = "V/krpm phase peak" }', {"psi_m": 0.1920}),
    "k_e of a phase, rms": ('n_p = 4\nk_e = { value = 56.86, unit = "Vrms/krpm phase" }', {"psi_m": 0.1920}),
    # The torque constant of hobby motors is 8.27/KV: 8.27/330 = 0.02506 N m/A = 1.5 · 7 · 0.002387.
    "KV": ("poles = 14\nkv = 330", {"psi_m": 0.002387, "n_p": 7}),
    "KV with its unit": ('n_p = 7\nkv = { value = 330, unit = "rpm/V" }', {"psi_m": 0.002387}),
    "KV by rms": ('n_p = 7\nkv = { value = 330, unit = "rpm/V rms" }', {"psi_m": 0.003375}),
    "terminals": (
        'n_p = 4\nr_ll = 0.34\nl_ll = { value = 3.8, unit = "mH" }',
        {"r_s": 0.17, "l_d": 0.0019, "l_q": 0.0019},
    ),
    "phase values in units": (
        'n_p = 4\nr_s = { value = 50, unit = "mΩ" }\nl_d = { value = 20, unit = "µH" }\n'
        'psi_m = { value = 5.1, unit = "mWb" }',
        {"r_s": 0.05, "l_d": 2e-5, "psi_m": 0.0051},
    ),
    # 67.27 N m at 41.56 A rms: 1.6186 N m/A
    "rated point": (
        'n_p = 4\ntau_rated = 67.27\ni_rated = { value = 41.56, unit = "A rms" }',
        {"psi_m": 0.1908, "i_rated": 58.77},
    ),
    "inertia in kg cm2": ('n_p = 4\nj = { value = 80, unit = "kg·cm²" }', {"j": 0.008}),
    "inertia in g cm2": ('n_p = 4\nj = { value = 181, unit = "gcm2" }', {"j": 1.81e-5}),
    # 1 oz in s2 = 7.0616e-3 kg m2, and 1 lb in2 = 2.9264e-4 kg m2
    "inertia in oz in s2": ('n_p = 4\nj = { value = 0.0019, unit = "oz-in-sec^2" }', {"j": 1.342e-5}),
    "inertia in lb in2": ('n_p = 4\nj = { value = 2.0, unit = "lb-in²" }', {"j": 5.853e-4}),
    "inertia in ten to the minus four": ('n_p = 4\nj = { value = 1.3, unit = "×10⁻⁴ kg·m²" }', {"j": 1.3e-4}),
    "inertia in plain powers": ('n_p = 4\nj = { value = 1.3, unit = "10^-4 kgm2" }', {"j": 1.3e-4}),
    "inertia with the power behind": ('n_p = 4\nj = { value = 1.3, unit = "kg·m^2·1e-4" }', {"j": 1.3e-4}),
    # 1 gf cm s2 = 9.80665e-5 N m s2
    "inertia in gf cm s2": ('n_p = 4\nj = { value = 1.5, unit = "gf·cm·s²" }', {"j": 1.471e-4}),
    # 2 kgf cm/A rms = 0.19613 N m/A rms: 0.19613/(1.5 · 1.41421 · 4)
    "k_t in kgf cm": ('n_p = 4\nk_t = { value = 2, unit = "kgf·cm/Arms" }', {"psi_m": 0.023114}),
    # 0.12 N m at 104.72 rad/s
    "friction": ('n_p = 4\nb = { value = 0.12, unit = "N·m/krpm" }', {"b": 0.001146}),
    "friction in oz in": ('n_p = 4\nb = { value = 1.5, unit = "oz-in/krpm" }', {"b": 1.0115e-4}),
}


@pytest.mark.parametrize("case", SHEETS)
def test_data_sheets(case: str, read: Read) -> None:
    text, parameters = SHEETS[case]
    described = read(text)
    for name, value in parameters.items():
        # four digits of the hand
        assert getattr(described.machine, name) == pytest.approx(value, rel=3e-4), name
    assert {name for entry in described.converted for name, _ in entry.gives} == {*parameters}
    assert all(entry.taken and entry.why is None for entry in described.converted)


def test_plain_si_values_are_not_converted(read: Read) -> None:
    described = read("n_p = 4\nr_s = 1\npsi_m = 0.2\nj = 0.01")
    assert described.converted == ()
    assert described.machine == pm.Machine(n_p=4, r_s=1.0, psi_m=0.2, j=0.01)


REFUSED = {
    "k_t without amplitude": (
        "n_p = 4\nk_t = 0.85",
        ["machine.k_t", "0.1002 V s by N·m/A rms", "0.1417 V s by N·m/A peak", 'unit = "N·m/A rms"'],
    ),
    "k_t without amplitude in its unit": (
        'n_p = 4\nk_t = { value = 850, unit = "mNm/A" }',
        ["0.1002 V s by mNm/A rms", "0.1417 V s by mNm/A peak"],
    ),
    "k_t without pole pairs": ("k_t = 0.85", ["machine.n_p", "n_p psi_m is 0.4007 V s by N·m/A rms"]),
    "bare k_e": (
        "n_p = 4\nk_e = 98",
        ["8 ways", "0.1910 V s by V/krpm line-to-line rms", "14.15 V s by V s"],
    ),
    "k_e without amplitude": (
        'n_p = 4\nk_e = { value = 98, unit = "V/krpm line-to-line" }',
        ["2 ways", "0.1910 V s by V/krpm line-to-line rms", "0.1351 V s by V/krpm line-to-line peak"],
    ),
    "k_e of a phase or of two": (
        'n_p = 4\nk_e = { value = 98, unit = "Vrms/krpm" }',
        ["2 ways", "0.1910 V s by Vrms/krpm line-to-line", "0.3309 V s by Vrms/krpm phase"],
    ),
    "peak to peak": ('n_p = 4\nk_e = { value = 98, unit = "V pk-pk/krpm" }', ["k_e.unit", "V/krpm"]),
    "k_e per hertz": ('n_p = 4\nk_e = { value = 1, unit = "V/Hz line-to-line rms" }', ["k_e.unit"]),
    "rated current without amplitude": (
        "n_p = 4\ni_rated = 3",
        ["4.243 A peak by A rms", "3.000 A peak by A"],
    ),
    "text": ('n_p = 4\nk_t = "0.85 N m/A rms"', ['k_t = { value = 0.85, unit = "N m/A rms" }']),
    "no number": ("n_p = 4\nk_t = true", ["machine.k_t", "k_t = { value = ..."]),
    "no unit": ("n_p = 4\nj = { value = 80 }", ["machine.j.unit", "missing"]),
    "wrong key": ('n_p = 4\nj = { valu = 8, unit = "g m2" }', ["machine.j.valu", "did you mean 'value'"]),
    "unit of something else": ('n_p = 4\nj = { value = 8, unit = "kg" }', ["machine.j.unit", "kg·cm²"]),
    "mega for milli": ('n_p = 4\nl_d = { value = 8, unit = "MH" }', ["machine.l_d.unit", "mH"]),
    "words that say nothing": ('n_p = 4\npsi_m = { value = 1, unit = "V s rms" }', ["psi_m.unit"]),
    "negative": ("n_p = 4\nr_ll = -1", ["machine.r_ll", "greater than 0"]),
    "smaller than a number can be": ('n_p = 4\nn_0 = { value = 5e-324, unit = "rpm" }', ["machine.n_0"]),
    "odd poles": ("poles = 7", ["machine.poles", "even", "pairs"]),
    "broken poles": ("poles = 14.0", ["machine.poles"]),
    "poles as pairs": ("poles = 14\nn_p = 14", ["machine.poles", "7 pairs", "n_p = 14"]),
    "gear": ("n_p = 4\ngear = 9", ["machine.gear", "scale = 9.0", "tau_m by the inverse"]),
    "gear ratio": ("n_p = 4\ngear_ratio = 9", ["machine.gear_ratio", "tau_m by the inverse"]),
    "k_t against k_e": (
        'n_p = 4\nk_t = { value = 1.629, unit = "N·m/A rms" }\n'
        'k_e = { value = 1.33, unit = "V s/rad line-to-line rms" }',
        ["contradict", "0.2715 V s", "0.1920 V s", "k_e as line-to-line peak (0.1920 V s)", "k_t as peak"],
    ),
    "k_t against psi_m": (
        'n_p = 4\npsi_m = 0.1\nk_t = { value = 1.629, unit = "N·m/A rms" }',
        ["psi_m and k_t contradict", "0.1920 V s", "no other reading"],
    ),
    "r_ll against r_s": ("n_p = 4\nr_s = 1.0\nr_ll = 1.0", ["machine.r_ll", "0.5000 ohm"]),
    "l_ll beside one axis": ("n_p = 4\nl_d = 1e-3\nl_ll = 1e-3", ["machine.l_ll", "give both"]),
    "l_ll outside": ("n_p = 4\nl_d = 1e-3\nl_q = 3e-3\nl_ll = 1e-3", ["machine.l_ll", "not between"]),
    "rated torque alone": ("n_p = 4\ntau_rated = 3", ["machine.tau_rated", "i_rated"]),
    "rated current twice": (
        'n_p = 4\ni_rated = { value = 3, unit = "A rms" }\n[drive]\ni_rated = 3',
        ["machine.i_rated", "[drive]"],
    ),
    "unknown key": ("n_p = 4\nke = 1", ["machine.ke", "did you mean 'k_e'"]),
    "a drive that is none": ('n_p = 4\ni_rated = { value = 3, unit = "A rms" }\n[[drive]]\nx = 1', ["drive"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused(case: str, read: Read) -> None:
    text, words = REFUSED[case]
    told = refusal(read, text)
    assert "\n" not in told
    for word in words:
        assert word in told, told


def test_constants_that_agree_are_told_and_the_voltage_goes_first(read: Read) -> None:
    described = read(
        'n_p = 4\nk_t = { value = 1.629, unit = "N·m/A rms" }\n'
        'k_e = { value = 1.33, unit = "V s/rad line-to-line peak" }'
    )
    assert described.machine.psi_m == pytest.approx(1.33 / math.sqrt(3.0) / 4.0, rel=1e-12)
    first, second = described.converted
    assert (first.key, first.taken, second.key, second.taken) == ("k_e", True, "k_t", False)
    assert dict(second.gives)["psi_m"] == pytest.approx(PSI, rel=1e-12)


def test_what_is_given_in_two_ways_keeps_the_plain_one(read: Read) -> None:
    described = read("n_p = 4\npoles = 8\nr_s = 0.18\nr_ll = 0.34\nl_d = 1e-3\nl_q = 3e-3\nl_ll = 4e-3")
    assert described.machine == pm.Machine(n_p=4, r_s=0.18, l_d=1e-3, l_q=3e-3)
    assert not any(entry.taken for entry in described.converted)


def test_the_rated_point_only_stands_in_for_a_flux(read: Read) -> None:
    rated = 'tau_rated = 90\ni_rated = { value = 41.56, unit = "A rms" }'
    described = read(f"n_p = 4\npsi_m = 0.192\n{rated}")
    assert described.machine.psi_m == 0.192
    assert [entry.taken for entry in described.converted] == [True, False]


def test_no_load_values_are_told_and_never_taken(read: Read) -> None:
    described = read('n_p = 4\npsi_m = 0.192\ni_0 = { value = 0.5, unit = "A peak" }\nn_0 = 1700')
    assert described.machine.b is None
    speed, current = described.converted
    assert dict(speed.gives)["omega_m"] == pytest.approx(178.02, rel=1e-4)
    # 1.5 · 4 · 0.192 · 0.5 N m, over 178.02 rad/s
    assert dict(current.gives) == pytest.approx({"tau_friction": 0.576, "b_at_most": 0.0032355}, rel=1e-4)
    assert "Coulomb" in (current.why or "")
    lone = read('n_p = 4\ni_0 = { value = 0.5, unit = "A peak" }').converted[0]
    assert (lone.gives, lone.taken) == ((), False)


@pytest.mark.parametrize(("quantity", "text"), [(q, text) for q, texts in EXAMPLES.items() for text in texts])
def test_units_that_messages_offer_are_known(quantity: str, text: str) -> None:
    assert compound(text, quantity) is not None


@given(
    st.floats(1e-4, 10.0),
    st.integers(1, 40),
    st.sampled_from(
        [
            ("k_t", "N·m/A peak", lambda p: 1.5 * p),
            ("k_t", "mNm/Arms", lambda p: 1.5e3 * math.sqrt(2.0) * p),
            ("k_e", "V/krpm line-to-line rms", lambda p: math.sqrt(1.5) * p * KRPM),
            ("k_e", "V s/rad line-to-line peak", lambda p: math.sqrt(3.0) * p),
            ("k_e", "mV/rpm phase peak", lambda p: p * KRPM),
            ("k_e", "Vrms/(rad/s) phase", lambda p: p / math.sqrt(2.0)),
            ("kv", "rpm/V", lambda p: 60.0 / (2.0 * math.pi * math.sqrt(3.0) * p)),
        ]
    ),
)
def test_a_flux_linkage_survives_the_way_to_the_data_sheet_and_back(
    tmp_path_factory: pytest.TempPathFactory,
    psi_m: float,
    n_p: int,
    way: tuple[str, str, Callable[[float], float]],
) -> None:
    key, unit, forward = way
    path = tmp_path_factory.mktemp("sheet") / "m.toml"
    value = forward(n_p * psi_m)
    path.write_text(f'[machine]\nn_p = {n_p}\n{key} = {{ value = {value!r}, unit = "{unit}" }}\n')
    # some ten operations, half an epsilon each
    assert read_machine(path).machine.psi_m == pytest.approx(psi_m, rel=1e-14)


@given(st.floats(1e-6, 1.0), st.sampled_from([text for text in EXAMPLES["inertia"]]))
def test_an_inertia_survives_the_way_to_the_data_sheet_and_back(
    tmp_path_factory: pytest.TempPathFactory, j: float, unit: str
) -> None:
    known = compound(unit, "inertia")
    assert known is not None
    path = tmp_path_factory.mktemp("sheet") / "m.toml"
    path.write_text(f'[machine]\nn_p = 4\nj = {{ value = {j / known.factor!r}, unit = "{unit}" }}\n')
    assert read_machine(path).machine.j == pytest.approx(j, rel=1e-14)


@given(st.text(max_size=30), st.sampled_from(sorted(EXAMPLES)))
def test_any_text_may_be_a_unit(text: str, quantity: str) -> None:
    found = compound(text, quantity)
    assert found is None or (math.isfinite(found.factor) and found.factor > 0)


SHEET = """[machine]
poles = 8
k_t = { value = 1.349, unit = "N·m/A rms" }
r_ll = 2.4834
l_d = { value = 8.1577, unit = "mH" }
l_q = 0.0070576
j = { value = 44.298, unit = "kg·cm²" }
"""


def test_identify_tells_what_it_converted(tmp_path: Path, run: Callable[..., Ran]) -> None:
    machine, out = tmp_path / "m.toml", tmp_path / "a.json"
    machine.write_text(SHEET)
    recording = recording_files()[0]
    ran = run(
        "identify", recording, "--machine", machine, "--fit", "r_s", "--method", "lm", "--json", str(out)
    )
    assert ran.code in (0, 4), ran.err
    text = " ".join(ran.out.split())
    assert "nameplate: n_p = 4 from poles = 8; l_d = 8.158 mH from 8.1577 mH; " in text
    assert "r_s = 1.242 Ω from r_ll = 2.4834 ohm" in text
    entries = {entry["from"]: entry for entry in json.loads(out.read_text())["nameplate"]}
    assert [*entries] == ["poles", "l_d", "j", "r_ll", "k_t"]
    assert entries["k_t"]["gives"]["psi_m"] == {"value": pytest.approx(0.15898, rel=1e-4), "unit": "V s"}
    plain = pm.identify(
        pm.load(recording), read_machine(machine).machine, fit=["r_s"], method="lm", uncertainties=False
    )
    assert plain.nameplate == ()
    assert "nameplate" not in plain.data


def test_diagnose_tells_what_it_converted(tmp_path: Path) -> None:
    machine = tmp_path / "m.toml"
    machine.write_text(SHEET)
    columns = pm.load(recording_files()[0], machine)
    short = pm.Recording({name: columns.column(name)[:2000] for name in columns.names})
    answer = pm.diagnose(short, machine)
    assert "nameplate: n_p = 4 from poles = 8; " in " ".join(str(answer).split())
    again = pm.Diagnosis.from_json(answer.to_json())
    assert again.nameplate == answer.nameplate
    assert len(again.nameplate) == 5
    answer.report(str(tmp_path / "r.html"))
    assert "Nameplate: n" in (tmp_path / "r.html").read_text()
