//! What an omitted effect is: data that describe it, and small functions that say where it enters the equations.
//!
//! The model is written in flux linkages. With the field energy W(λ_d, λ_q, θ) per 3/2 of the machine,
//!
//! > dλ_d/dt = v_d − v_lost,d − r_s i_d + ω λ_q,  dλ_q/dt = v_q − v_lost,q − r_s i_q − ω λ_d,
//! > i_d = ∂W/∂λ_d,  i_q = ∂W/∂λ_q,  τ_e = 3/2 n_p (λ_d i_q − λ_q i_d − ∂W/∂θ),
//!
//! so every magnetic effect is a term of one energy and its cross terms are reciprocal by construction. An effect
//! implements only the hooks through which it enters; the defaults do nothing. All hooks are generic over the
//! number type, and with all its parameters at zero an effect must leave the bare machine bit for bit.

use crate::base::Base;
use crate::numerics::real::Real;
use std::fmt;

/// The part of the model in which an effect sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Site {
    /// Voltage equations.
    Electrical,
    /// Equation of motion.
    Mechanical,
    /// Measured side: sensors and their frame.
    Sensor,
}

/// How a parameter of an effect is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Strength: the effect vanishes when all strengths are zero. Fitted.
    Amplitude,
    /// Form: has no influence at zero strength. Started from [`Effect::probes`], then fitted.
    Shape,
    /// A whole number or a regularisation: chosen from [`Effect::probes`], never fitted.
    Fixed,
}

/// A value that follows from the scales of a machine and recording, or is the same for all.
pub type Scaled = &'static (dyn Fn(&Context) -> f64 + Send + Sync);

/// A parameter of an effect.
#[derive(Clone, Copy)]
pub struct Parameter {
    /// Name in results.
    pub name: &'static str,
    /// SI unit, "1" for a pure number.
    pub unit: &'static str,
    /// What it means, in words.
    pub meaning: &'static str,
    /// How it is found.
    pub role: Role,
    /// Lowest physical value for this machine and recording.
    pub low: Scaled,
    /// Highest physical value for this machine and recording.
    pub high: Scaled,
    /// Typical value, where a reader or a search may start.
    pub typical: Scaled,
}

impl fmt::Debug for Parameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} in {}, {:?}", self.name, self.unit, self.role)
    }
}

impl Parameter {
    /// Part of a torque that swings about zero: up to the largest torque of the motor either way, a hundredth of it where one is there.
    pub const fn torque(name: &'static str, meaning: &'static str) -> Self {
        Self {
            name,
            unit: "N m",
            meaning,
            role: Role::Amplitude,
            low: &|cx| -cx.tau_max,
            high: &|cx| cx.tau_max,
            typical: &|cx| 0.01 * cx.tau_max,
        }
    }

    /// Whether it counts sample periods (its name ends so), which are of another length in another recording.
    pub fn counts_samples(&self) -> bool {
        self.name.ends_with("_samples")
    }
}

/// What a recording must contain to show an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// Electrical (or mechanical) rotor angle.
    Angle,
    /// Electrical rotor angle, or operating points, of which each is a mean over whole revolutions.
    AngleOrSteady,
    /// A transient recording, not operating points.
    Transients,
    /// A rotor that turns.
    Motion,
    /// A shaft that turns round, at least once.
    Turn,
    /// A shaft that turns to and fro, through [`LEAST_SWING`] at least and less than a turn.
    Swing,
    /// Terminals through which current flows.
    Current,
    /// Operating points or transients over a measured temperature or long enough to heat up by themselves.
    Time,
}

/// Least angle through which a shaft must swing to show more of a torque over its angle than a straight line, rad: 30°, over which the
/// curve of a sine leaves its tangent by 1 %.
pub const LEAST_SWING: f64 = std::f64::consts::FRAC_PI_6;

/// The description of an effect, from which Python, command line and documentation are generated.
#[derive(Debug, Clone, Copy)]
pub struct Info {
    /// Identifier in files and answers; it never changes its meaning.
    pub id: &'static str,
    /// Short title.
    pub title: &'static str,
    /// One sentence in plain words: what was left out.
    pub sentence: &'static str,
    /// Equation in Unicode.
    pub equation: &'static str,
    /// Where the equation comes from.
    pub source: &'static str,
    /// What it looks like in a residual.
    pub fingerprint: &'static str,
    /// Effects that resemble it.
    pub look_alikes: &'static [&'static str],
    /// Effects that are special cases of this one.
    pub contains: &'static [&'static str],
    /// Where it sits.
    pub site: Site,
    /// What the recording must contain.
    pub needs: &'static [Need],
    /// Its parameters, in the order of the parameter slice that the hooks receive.
    pub parameters: &'static [Parameter],
}

/// Scales of one machine and recording, from which bounds and regularisations follow.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Context {
    /// Pole pairs.
    pub n_p: f64,
    /// Largest current vector, A.
    pub i_max: f64,
    /// Largest voltage vector, V.
    pub v_max: f64,
    /// Largest electrical speed, rad/s.
    pub omega_e_max: f64,
    /// Largest motor torque, N·m.
    pub tau_max: f64,
    /// Largest flux linkage, V s.
    pub psi_max: f64,
    /// Mechanical angle between the ends of the shaft's motion, rad.
    pub swing: f64,
    /// Duration, s.
    pub duration: f64,
    /// Sample period, s.
    pub period: f64,
    /// Nominal DC-link voltage, V; without a nameplate the smallest one that could give the largest voltage.
    pub v_dc: f64,
    /// Reciprocal of the shortest electrical time constant of the nameplate, rad/s.
    pub electrical_rate: f64,
    /// Mean of the three phase currents, A (zero where fewer than three are logged).
    pub zero_sequence: f64,
    /// Number of the phase whose current was not logged but completed to zero sum, if one was.
    pub completed_phase: Option<usize>,
    /// Whether a load torque other than zero is known.
    pub load_known: bool,
    /// Whether samples are steady operating points, each a mean over whole revolutions.
    pub steady: bool,
    /// Whether a winding temperature is logged.
    pub has_temperature: bool,
    /// Whether a magnet temperature is logged.
    pub has_magnet_temperature: bool,
}

impl Context {
    /// Largest mechanical speed, rad/s.
    pub fn omega_m_max(&self) -> f64 {
        self.omega_e_max / self.n_p
    }
}

/// Where the machine is: time, speed, angle and temperatures.
#[derive(Debug, Clone, Copy)]
pub struct Env<T> {
    /// Time since the first sample, s.
    pub t: T,
    /// Electrical speed, rad/s.
    pub omega_e: T,
    /// Electrical angle, rad, unwrapped.
    pub theta_e: T,
    /// Mechanical angle, rad, unwrapped.
    pub theta_m: T,
    /// Winding temperature above 20 °C where it is logged, else zero, K.
    pub heating: f64,
    /// Magnet temperature above 20 °C where it is logged, else zero, K.
    pub magnet_heating: f64,
}

/// The electrical state at which a hook is evaluated.
#[derive(Debug, Clone, Copy)]
pub struct Electrical<T> {
    /// Where the machine is.
    pub env: Env<T>,
    /// Sine and cosine of the electrical angle.
    pub sin_cos: (T, T),
    /// Stator current d, q, A.
    pub i: [T; 2],
    /// Stator resistance now, Ω.
    pub r_s: T,
    /// Commanded voltage d, q, V.
    pub v: [T; 2],
    /// Voltage induced in the winding, dλ/dt and rotation, d, q, V (zero until the voltage losses are known).
    pub emf: [T; 2],
}

/// Where the field energy is evaluated.
#[derive(Debug, Clone, Copy)]
pub struct FieldPoint<T> {
    /// Total flux linkage d, q, V s.
    pub flux: [T; 2],
    /// The magnet's part of it, V s.
    pub magnet: [T; 2],
    /// Fundamental of the magnet's flux, V s.
    pub psi_m: T,
    /// Sine and cosine of the electrical angle (of zero where no effect asks for the angle).
    pub sin_cos: (T, T),
}

/// The mechanical state at which a hook is evaluated.
#[derive(Debug, Clone, Copy)]
pub struct Mechanical<T> {
    /// Where the machine is.
    pub env: Env<T>,
    /// Mechanical speed, rad/s.
    pub omega_m: T,
    /// Motor torque, N·m.
    pub tau_e: T,
    /// Load torque, N·m.
    pub tau_load: T,
    /// Inertia, kg m².
    pub j: T,
}

/// Parameters that drift: factors on the base values.
#[derive(Debug, Clone, Copy)]
pub struct Drift<T> {
    /// Factor on r_s.
    pub r_s: T,
    /// Factor on psi_m.
    pub psi_m: T,
}

/// Flux of the magnet in the winding and its derivative with respect to the electrical angle.
#[derive(Debug, Clone, Copy)]
pub struct Magnet<T> {
    /// λ_d, λ_q of the magnet, V s.
    pub flux: [T; 2],
    /// Derivative with respect to θ_e, V s/rad.
    pub slope: [T; 2],
}

/// First and second derivatives of the field energy.
#[derive(Debug, Clone, Copy)]
pub struct Field<T> {
    /// i_d, i_q = ∂W/∂λ, A.
    pub i: [T; 2],
    /// ∂W/∂θ_e at fixed flux linkage, A V s.
    pub slope: T,
    /// ∂²W/∂λ_d², ∂²W/∂λ_d∂λ_q, ∂²W/∂λ_q², 1/H.
    pub inverse: [T; 3],
}

/// What acts on the rotor.
#[derive(Debug, Clone, Copy)]
pub struct Rotor<T> {
    /// One over the inertia that follows the rotor rigidly, 1/(kg m²).
    pub inverse_inertia: T,
    /// Torque lost against positive rotation, N·m.
    pub loss: T,
    /// Load torque that reaches the rotor, N·m.
    pub load: T,
}

/// Errors of the measuring side.
#[derive(Debug, Clone, Copy)]
pub struct Sensor<T> {
    /// Gain of each phase-current sensor.
    pub gain: [T; 3],
    /// Offset of each phase-current sensor, A, measured minus true.
    pub offset: [T; 3],
    /// Measured minus true electrical angle, rad.
    pub angle: T,
    /// Derivative of `angle` with respect to the electrical angle.
    pub angle_slope: T,
}

/// A result of an effect: name, unit, value.
pub type Output<T> = (&'static str, &'static str, T);

/// A result that is no parameter: name, unit, meaning.
pub type Derived = (&'static str, &'static str, &'static str);

/// An omitted effect. See the module's documentation for the meaning of the hooks.
pub trait Effect {
    /// Its description.
    const INFO: Info;
    /// Number of its own electrical or thermal states.
    const ELECTRICAL_STATES: usize = 0;
    /// Number of its own mechanical states.
    const MECHANICAL_STATES: usize = 0;
    /// Results that are none of its parameters.
    const DERIVED: &'static [Derived] = &[];
    /// The effect of which this one is the finer part: where both are found, this one is the news.
    const REFINES: Option<&'static str> = None;
    /// Share of its strength by which its parameters scatter against plants that have the same physics in another form, such as
    /// another transition through zero: as a standard deviation. Read off the independent plants in `proof/`.
    const FORM: f64 = 0.005;
    /// Whether its derivative at zero strength tells how much it can explain.
    const FIRST_ORDER: bool = true;
    /// Whether its fit has so many minima that its parameters are looked for by a swarm, where nothing else explains the motion.
    const MULTIMODAL: bool = false;
    /// Whether its name covers every function of its variables, of which its equation is one form: a map over them is no other cause.
    const GENERAL: bool = false;
    /// Whether its torque jumps where the speed changes its sign, as an unknown load that changes in steps may do, too.
    const JUMPS: bool = false;
    /// Whether it is a curve over the speed that a smooth term describes as well but for standstill: beside an unexplained torque it is named
    /// only for what no such term fits.
    const SMOOTH: bool = false;
    /// Whether its electrical states are temperatures: they begin at zero with the recording, go on over its gaps, and change too
    /// slowly for a sample to matter.
    const THERMAL: bool = false;
    /// Whether it has a [`Effect::field`] or [`Effect::shunt`], so that the flux of a current must be iterated for.
    const MAGNETIC: bool = false;

    /// Whether the torque of given currents depends on it. It does not where all that it changes is the voltage of the winding or its
    /// resistance.
    const TURNS: bool = true;

    /// Points from which the parameters are tried: shapes and whole numbers on a grid. Amplitudes are ignored.
    fn probes(cx: &Context) -> Vec<Vec<f64>> {
        vec![Self::INFO.parameters.iter().map(|p| (p.typical)(cx)).collect()]
    }
    /// Whether parameter `index` is to be fitted on this kind of recording.
    fn fitted(cx: &Context, index: usize) -> bool {
        let _ = cx;
        Self::INFO.parameters[index].role != Role::Fixed
    }
    /// Whether with these parameters it does nothing in the recording of what it is named for.
    fn idles(p: &[f64], cx: &Context) -> bool {
        let _ = (p, cx);
        false
    }
    /// Multiplies drifting parameters.
    fn drift<T: Real>(p: &[T], x: &[T], env: &Env<T>, cx: &Context, out: &mut Drift<T>) {
        let _ = (p, x, env, cx, out);
    }
    /// Adds to the magnet's flux; `psi_m` is its fundamental now.
    fn magnet<T: Real>(p: &[T], psi_m: T, env: &Env<T>, cx: &Context, out: &mut Magnet<T>) {
        let _ = (p, psi_m, env, cx, out);
    }
    /// Adds to the currents that the flux linkage calls for; the magnet alone must call for none.
    fn field<T: Real>(p: &[T], at: &FieldPoint<T>, base: &Base<T>, cx: &Context, out: &mut Field<T>) {
        let _ = (p, at, base, cx, out);
    }
    /// Turns the logged voltage command into the one that acts: `taps` are the commands of this and the two samples before,
    /// each in the rotor frame of its own interval, `turn` the electrical angle per interval.
    fn command<T: Real>(p: &[T], taps: &[[T; 2]; 3], turn: T, cx: &Context, v: &mut [T; 2]) {
        let _ = (p, taps, turn, cx, v);
    }
    /// Adds to the terminal current what bypasses the magnetising branch (d, q), A.
    fn shunt<T: Real>(p: &[T], x: &[T], sin_cos: (T, T), cx: &Context, i: &mut [T; 2]) {
        let _ = (p, x, sin_cos, cx, i);
    }
    /// Quasi-static start of its own electrical states where the winding is; zero by default.
    fn electrical_start<T: Real>(p: &[T], at: &Electrical<T>, cx: &Context, x: &mut [T]) {
        let _ = (p, at, cx, x);
    }
    /// The same effect seen from a mechanical zero that lies `shift` (rad) further; only effects that know whole
    /// mechanical turns change. Returns whether it is one of them.
    fn turned(p: &mut [f64], shift: f64) -> bool {
        let _ = (p, shift);
        false
    }
    /// Adds to the voltage lost between command and winding (d, q), V.
    fn voltage<T: Real>(p: &[T], x: &[T], at: &Electrical<T>, cx: &Context, lost: &mut [T; 2]) {
        let _ = (p, x, at, cx, lost);
    }
    /// Derivatives of its own electrical or thermal states; `at.emf` is known.
    fn electrical_states<T: Real>(p: &[T], x: &[T], at: &Electrical<T>, cx: &Context, dx: &mut [T]) {
        let _ = (p, x, at, cx, dx);
    }
    /// Changes what acts on the rotor. Without mechanical states of its own an effect adds to the loss, whatever is there already, and changes
    /// nothing else.
    fn rotor<T: Real>(p: &[T], x: &[T], at: &Mechanical<T>, cx: &Context, out: &mut Rotor<T>) {
        let _ = (p, x, at, cx, out);
    }
    /// Derivatives of its own mechanical states.
    fn mechanical_states<T: Real>(
        p: &[T],
        x: &[T],
        at: &Mechanical<T>,
        acceleration: T,
        cx: &Context,
        dx: &mut [T],
    ) {
        let _ = (p, x, at, acceleration, cx, dx);
    }
    /// Quasi-static start of its own mechanical states at an acceleration in rad/s².
    fn mechanical_start<T: Real>(p: &[T], at: &Mechanical<T>, acceleration: T, cx: &Context, x: &mut [T]) {
        let _ = (p, at, acceleration, cx, x);
    }
    /// Frequency (Hz) at which the effect lets the speed ring of itself; zero if it does not.
    fn ringing<T: Real>(p: &[T]) -> T {
        let _ = p;
        T::zero()
    }
    /// Steepest slope of the voltage that it takes away over the current, V/A; zero where that stays near the resistance. The currents then
    /// change by as much faster, and are simulated in shorter steps.
    fn steepness<T: Real>(p: &[T], cx: &Context) -> T {
        let _ = (p, cx);
        T::zero()
    }
    /// Changes what the sensors show; `env` holds the measured angle.
    fn sensor<T: Real>(p: &[T], env: &Env<T>, cx: &Context, out: &mut Sensor<T>) {
        let _ = (p, env, cx, out);
    }
    /// The results that a user wants to read; by default the parameters themselves.
    fn outputs<T: Real>(p: &[T], base: &Base<T>, cx: &Context) -> Vec<Output<T>> {
        let _ = (base, cx);
        Self::INFO.parameters.iter().zip(p).map(|(info, value)| (info.name, info.unit, *value)).collect()
    }
}
