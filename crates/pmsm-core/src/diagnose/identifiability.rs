//! Identifiability of effects: which ones the signals of recordings can show.

use super::data::Data;
use crate::base::BASE;
use crate::effect::{Context, Env, LEAST_SWING, Need, Site};
use crate::effects::{self, EffectId};
use crate::model::Model;
use crate::recording::{Kind, Load};
use std::f64::consts::TAU;

/// Effects that the recordings can show, and the others with the reason.
pub fn identifiable(data: &Data) -> (Vec<EffectId>, Vec<(EffectId, String)>) {
    let (mut identifiable, mut unidentifiable) = (Vec::new(), Vec::new());
    let own = &data.options.effects;
    let known = effects::ALL.iter().copied().filter(|effect| !own.replace(*effect));
    for effect in known.chain(own.iter()) {
        match obstacle(data, effect) {
            None => identifiable.push(effect),
            Some(why) => unidentifiable.push((effect, why)),
        }
    }
    (identifiable, unidentifiable)
}

/// Why the recordings cannot be asked about an effect: none of them shows it, or one of them would need a signal that it does
/// not hold.
fn obstacle(data: &Data, effect: EffectId) -> Option<String> {
    let runs = data.runs();
    let hidden: Vec<Option<String>> = runs.iter().map(|run| hidden(run, effect)).collect();
    if hidden.iter().all(Option::is_some) {
        return hidden.into_iter().next().flatten();
    }
    let lacking = runs.iter().enumerate().find_map(|(at, run)| Some((at, lacking(run, effect)?)));
    lacking.map(|(at, why)| match data.number(at) {
        None => why,
        Some(number) => format!("{why} in recording {number}"),
    })
}

/// Why a recording by itself shows nothing of an effect, if so.
fn hidden(data: &Data, effect: EffectId) -> Option<String> {
    let (signals, info) = (&data.signals, effect.info());
    match (info.site, signals.kind) {
        (Site::Electrical | Site::Sensor, Kind::Mechanical | Kind::OperatingPoints)
            if signals.limits.coarse.is_some() =>
        {
            return Some("the rows lie too far apart for what the voltage does between them".into());
        }
        (Site::Electrical | Site::Sensor, Kind::Mechanical) => {
            return Some("the recording has no voltages".into());
        }
        (Site::Mechanical, Kind::Electrical | Kind::OperatingPoints | Kind::OpenCircuit) => {
            return Some("the recording does not show the motion".into());
        }
        (Site::Sensor, Kind::OpenCircuit) if signals.angle_from_voltages => {
            return Some("the rotor angle was taken from the voltages themselves".into());
        }
        (Site::Mechanical, _) if signals.load == Load::Locked => return Some("the rotor is held".into()),
        (_, Kind::Electrical) if signals.angle_from_voltages => {
            if let Some(why) = taken_up(&signals.context, effect) {
                return Some(why);
            }
        }
        _ => {}
    }
    let (turning, swing) = (signals.context.omega_e_max > 1.0, signals.context.swing);
    info.needs.iter().find_map(|need| match need {
        Need::Motion if !turning => Some("the rotor does not turn".to_string()),
        Need::Turn if swing < TAU => Some("the shaft does not turn round".to_string()),
        Need::Swing if swing < LEAST_SWING => {
            Some(format!("the shaft swings through less than {:.0}°", LEAST_SWING.to_degrees()))
        }
        Need::Current if signals.kind == Kind::OpenCircuit => {
            Some("no current flows through open terminals".to_string())
        }
        _ => None,
    })
}

/// Why an angle that was taken from the voltages and currents hides an effect. That angle makes the model without effects explain them over
/// each turn. Effects that repeat within a turn still show; a constant one has become an error of the angle.
fn taken_up(context: &Context, effect: EffectId) -> Option<String> {
    if errs_in_angle(context, effect) {
        return Some("the rotor angle was taken from the voltages themselves".into());
    }
    if effect == EffectId::CurrentOffset {
        // A constant current through r_s and a constant voltage make the flux linkage drift alike, and that drift was taken out.
        return Some(
            "it cannot be told from offsets of the voltages, which were taken out with the angle".into(),
        );
    }
    let repeats = effect.info().needs.iter().any(|need| matches!(need, Need::Angle | Need::AngleOrSteady));
    (!repeats).then(|| {
        "it cannot be told from an error of the rotor angle, which was taken from the voltages".into()
    })
}

/// Whether an effect makes the measured angle err.
fn errs_in_angle(context: &Context, effect: EffectId) -> bool {
    let model = Model::new(*context, &[effect]);
    let typical = effect.info().parameters.iter().map(|p| (p.typical)(context));
    let p: Vec<f64> = std::iter::repeat_n(0.0, BASE).chain(typical).collect();
    let theta_e = 1.0;
    let env = Env {
        t: 0.0,
        omega_e: context.omega_e_max,
        theta_e,
        theta_m: theta_e / context.n_p,
        heating: 0.0,
        magnet_heating: 0.0,
    };
    model.sensor(&p, &env).angle != 0.0
}

/// What a recording lacks for an effect to be simulated on it, if anything.
fn lacking(data: &Data, effect: EffectId) -> Option<String> {
    let signals = &data.signals;
    if effect.info().site == Site::Mechanical && !data.has_mechanical() {
        // What acts on the motion alone is not simulated where none was recorded.
        return None;
    }
    let steady = signals.kind == Kind::OperatingPoints;
    effect.info().needs.iter().find_map(|need| match need {
        Need::AngleOrSteady if !signals.angle_known && !steady => {
            Some("the rotor angle was not recorded".to_string())
        }
        Need::Angle if !signals.angle_known => Some("the rotor angle was not recorded".to_string()),
        Need::Swing if signals.context.swing >= TAU => {
            Some("the shaft turns round, where such a load is a load_torque_pulsation of order 1".to_string())
        }
        Need::Transients if steady => {
            Some("operating points do not show what happens within a revolution".to_string())
        }
        Need::Time if steady && signals.heating.is_none() && signals.magnet_heating.is_none() => {
            Some("no temperature was recorded".to_string())
        }
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};
    use crate::drive::Manoeuvre;

    /// To and fro with speeds up to `fastest`, rad/s: through 0.2·`fastest`, rad.
    fn swinging(fastest: f64) -> Manoeuvre {
        speeds(0.8, &[(0.0, 0.0), (0.2, fastest), (0.6, -fastest), (0.8, 0.0)])
    }

    #[test]
    fn a_weight_is_asked_about_on_a_part_of_a_turn_and_a_pulsation_where_the_shaft_turns_round() {
        let (weight, pulsation) = (EffectId::GravityTorque, EffectId::LoadTorquePulsation);
        for (fastest, asked, why) in [
            (1.0, None, "through less than 30°"),
            (6.0, Some(weight), "does not turn round"),
            (60.0, Some(pulsation), "a load_torque_pulsation of order 1"),
        ] {
            let (data, _) = data(&setup(swinging(fastest), Vec::new()));
            let (identifiable, unidentifiable) = identifiable(&data);
            let both = [weight, pulsation];
            assert_eq!(both.into_iter().find(|e| identifiable.contains(e)), asked, "{fastest}");
            let reasons =
                unidentifiable.iter().filter(|(e, _)| both.contains(e)).map(|(_, why)| why.as_str());
            assert!(reasons.clone().any(|reason| reason.ends_with(why)), "{:?}", reasons.collect::<Vec<_>>());
        }
    }

    #[test]
    fn where_the_angle_was_taken_from_the_voltages_no_sensor_of_it_is_asked_about() {
        let context = data(&setup(swinging(60.0), Vec::new())).0.signals.context;
        let asked: Vec<EffectId> = effects::ALL
            .iter()
            .copied()
            .filter(|e| e.info().site == Site::Sensor && taken_up(&context, *e).is_none())
            .collect();
        assert_eq!(asked, [EffectId::CurrentGainImbalance]);
    }

    #[test]
    fn a_weight_does_not_stand_in_for_dry_friction() {
        let (data, base) = data(&setup(swinging(4.0), vec![choice("coulomb_friction", "tau_c", 1.0)]));
        let left = |effect: EffectId| {
            let fitted = fitted(&data, &base, effect);
            for (p, x) in effect.info().parameters.iter().zip(&fitted.own()[6..]) {
                let cx = fitted.model.context();
                assert!(((p.low)(cx)..=(p.high)(cx)).contains(x), "{effect:?} {} {x}", p.name);
            }
            fitted.squares.last().unwrap().1
        };
        let (friction, weight) = (left(EffectId::CoulombFriction), left(EffectId::GravityTorque));
        assert!(friction < 1.3 && weight > 3.0, "{friction} {weight}");
    }
}
