"""Machines of the proof, with bench noise of the size their drives have."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .parameters import Machine

# how much more or less of each number another machine of the same kind has
SPREAD = 1.6

# industrial servo of 2 kW coupled to a test bench, slight saliency, 17 bit encoder
SERVO = Machine(
    "servo",
    r_s=1.15,
    l_d=7.4e-3,
    l_q=8.7e-3,
    psi_m=0.19,
    n_p=4,
    j=5.2e-3,
    b=1.1e-3,
    i_rated=8.0,
    w_rated=230.0,
    v_dc=540.0,
    f_sample=10_000.0,
    noise_i=0.025,
    lsb_i=0.01,
    noise_w=0.15,
    encoder_bits=17,
    noise_tau=0.02,
)

# wheel hub motor on a battery: many poles, low voltage, heavy rotor
HUB = Machine(
    "hub48",
    r_s=0.058,
    l_d=1.55e-4,
    l_q=1.75e-4,
    psi_m=0.0182,
    n_p=15,
    j=0.034,
    b=0.011,
    i_rated=55.0,
    w_rated=38.0,
    v_dc=48.0,
    f_sample=16_000.0,
    noise_i=0.12,
    lsb_i=0.05,
    noise_w=0.25,
    encoder_bits=16,
    noise_tau=0.05,
)

# traction motor with buried magnets: strong saliency, large currents
TRACTION = Machine(
    "traction50",
    r_s=0.016,
    l_d=2.1e-4,
    l_q=5.6e-4,
    psi_m=0.071,
    n_p=4,
    j=0.062,
    b=0.013,
    i_rated=300.0,
    w_rated=420.0,
    v_dc=350.0,
    f_sample=10_000.0,
    noise_i=0.5,
    lsb_i=0.2,
    noise_w=0.2,
    encoder_bits=17,
    noise_tau=0.25,
)

# slow, high-voltage machine of an industrial drive
PUMP = Machine(
    "pump2k",
    r_s=3.0,
    l_d=0.036,
    l_q=0.047,
    psi_m=0.51,
    n_p=3,
    j=0.013,
    b=2.4e-3,
    i_rated=6.0,
    w_rated=160.0,
    v_dc=540.0,
    f_sample=10_000.0,
    noise_i=0.012,
    lsb_i=0.006,
    noise_w=0.08,
    encoder_bits=18,
    noise_tau=0.03,
)

# fast spindle: two pole pairs, light rotor, no saliency
SPINDLE = Machine(
    "spindle",
    r_s=0.35,
    l_d=1.1e-3,
    l_q=1.1e-3,
    psi_m=0.055,
    n_p=2,
    j=4.5e-4,
    b=8e-5,
    i_rated=12.0,
    w_rated=1200.0,
    v_dc=325.0,
    f_sample=20_000.0,
    noise_i=0.03,
    lsb_i=0.012,
    noise_w=0.3,
    encoder_bits=18,
    noise_tau=0.01,
)

# joint of a robot: flat outrunner behind a low voltage
JOINT = Machine(
    "joint48",
    r_s=0.19,
    l_d=1.3e-4,
    l_q=1.45e-4,
    psi_m=0.0095,
    n_p=14,
    j=1.6e-3,
    b=1.5e-3,
    i_rated=20.0,
    w_rated=95.0,
    v_dc=48.0,
    f_sample=20_000.0,
    noise_i=0.05,
    lsb_i=0.02,
    noise_w=0.25,
    encoder_bits=17,
    noise_tau=0.01,
)

# compressor with buried magnets: l_q is twice l_d
COMPRESSOR = Machine(
    "compressor3k",
    r_s=0.9,
    l_d=8.5e-3,
    l_q=0.017,
    psi_m=0.24,
    n_p=3,
    j=2.9e-3,
    b=9e-4,
    i_rated=10.0,
    w_rated=290.0,
    v_dc=540.0,
    f_sample=12_500.0,
    noise_i=0.025,
    lsb_i=0.01,
    noise_w=0.12,
    encoder_bits=17,
    noise_tau=0.02,
)

# gearless lift: many poles, slow, heavy
LIFT = Machine(
    "lift",
    r_s=0.62,
    l_d=0.0135,
    l_q=0.0158,
    psi_m=1.05,
    n_p=10,
    j=1.1,
    b=0.09,
    i_rated=22.0,
    w_rated=18.0,
    v_dc=560.0,
    f_sample=8_000.0,
    noise_i=0.05,
    lsb_i=0.02,
    noise_w=0.03,
    encoder_bits=19,
    noise_tau=1.5,
)

# outrunner of a drone's propeller: light, fast, small inductance
PROPELLER = Machine(
    "propeller24",
    r_s=0.055,
    l_d=2.6e-5,
    l_q=3.0e-5,
    psi_m=0.0021,
    n_p=7,
    j=6.5e-5,
    b=1.6e-6,
    i_rated=22.0,
    w_rated=520.0,
    v_dc=25.0,
    f_sample=20_000.0,
    noise_i=0.06,
    lsb_i=0.025,
    noise_w=0.8,
    encoder_bits=16,
    noise_tau=0.003,
)

# direct drive of a washing machine: many poles, outer rotor, behind a rectified 230 V line
WASHER = Machine(
    "washer",
    r_s=4.2,
    l_d=0.019,
    l_q=0.0225,
    psi_m=0.17,
    n_p=12,
    j=0.031,
    b=4.5e-3,
    i_rated=4.5,
    w_rated=60.0,
    v_dc=310.0,
    f_sample=16_000.0,
    noise_i=0.012,
    lsb_i=0.005,
    noise_w=0.2,
    encoder_bits=16,
    noise_tau=0.05,
)

MACHINES = {
    m.name: m for m in (SERVO, HUB, TRACTION, PUMP, SPINDLE, JOINT, COMPRESSOR, LIFT, PROPELLER, WASHER)
}


def another(machine: Machine, rng: np.random.Generator) -> Machine:
    """Another machine of the same kind: each of its numbers up to SPREAD times larger or smaller.

    Inductances grow together, and l_q further up to SPREAD times; the speed falls as the flux rises, so that
    the same link drives it.  Pole pairs, link, sample rate and resolutions stay.
    """

    def drawn() -> float:
        return math.exp(rng.uniform(-math.log(SPREAD), math.log(SPREAD)))

    flux, inductance, noise = drawn(), drawn(), drawn()
    return replace(
        machine,
        r_s=machine.r_s * drawn(),
        l_d=machine.l_d * inductance,
        l_q=machine.l_q * inductance * float(rng.uniform(1.0, SPREAD)),
        psi_m=machine.psi_m * flux,
        w_rated=machine.w_rated / flux,
        j=machine.j * drawn(),
        b=machine.b * drawn(),
        i_rated=machine.i_rated * drawn(),
        noise_i=machine.noise_i * noise,
        noise_w=machine.noise_w * noise,
    )
