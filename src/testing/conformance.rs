//! One suite for every constraint: gradient against oracles, invariants, degenerate shapes.

use nalgebra::{Point3, Vector3};

use super::draw::Draw;
use super::dual::Dual;
use super::subject::{Fixed, Subject};
use crate::constraints::{Parameter, Scalar, Spec};

/// A failed check.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{subject}: {check} failed (seed {seed}): {detail}")]
pub struct Failure {
    /// Name of the constraint.
    pub subject: String,
    /// Name of the check.
    pub check: &'static str,
    /// Seed that reproduces it.
    pub seed: u64,
    /// Numbers of the failure.
    pub detail: String,
}

/// Margin on the first-order error bound of the oracle; the analytic form has other rounding errors
/// (tolerance T2).
const MARGIN: f64 = 64.0;

/// Checks the gradient of a subject at `x` against dual numbers and finite differences; `size` is
/// the length scale of the shape. All gradient checks use this function, so that the negative
/// controls test it.
///
/// # Errors
/// The first failed check.
pub fn check<T: Subject>(
    name: &str,
    subject: &T,
    x: &[Point3<f64>],
    size: f64,
    draw: &mut Draw,
) -> Result<(), Failure> {
    let seed = draw.seed;
    let fail = |check, detail| Failure {
        subject: name.to_string(),
        check,
        seed,
        detail,
    };
    let Some((value, gradient)) = subject.value_and_gradient(x) else {
        return Err(fail("gradient exists", format!("undefined at {x:?}")));
    };
    // Before any comparison: a NaN hides in maxima and in negated comparisons.
    if !(value.is_finite() && gradient.iter().all(|g| g.iter().all(|c| c.is_finite()))) {
        return Err(fail(
            "finite",
            format!("C = {value}, gradient {gradient:?}"),
        ));
    }
    let steepest = gradient.iter().map(|g| g.amax()).fold(0.0, f64::max);
    if steepest <= 0.0 {
        return Err(fail("gradient is not zero", format!("at {x:?}")));
    }
    dual_exact(subject, x, &gradient, value).map_err(|d| fail("dual numbers (P2)", d))?;
    taylor(subject, x, &gradient, size, draw).map_err(|d| fail("finite differences (P1)", d))
}

/// P2: each component equals the dual number's slope within its own rounding.
fn dual_exact<T: Subject>(
    subject: &T,
    x: &[Point3<f64>],
    gradient: &[Vector3<f64>],
    value: f64,
) -> Result<(), String> {
    let mut point: Vec<Point3<Dual>> = x.iter().map(|p| p.map(Dual::of)).collect();
    for i in 0..x.len() {
        for axis in 0..3 {
            point[i][axis] = Dual::variable(x[i][axis]);
            let oracle = subject.value(&point);
            point[i][axis] = Dual::of(x[i][axis]);
            let tolerance = MARGIN * f64::EPSILON * oracle.slope.error;
            let error = (oracle.slope.value - gradient[i][axis]).abs();
            if !(error <= tolerance) {
                return Err(format!(
                    "point {i} axis {axis}: analytic {}, dual {}, allowed {tolerance:e}",
                    gradient[i][axis], oracle.slope.value
                ));
            }
            let off = (oracle.real.value - value).abs();
            if !(off <= MARGIN * f64::EPSILON * oracle.real.error) {
                return Err(format!(
                    "value {value} differs from {} by {off:e}",
                    oracle.real.value
                ));
            }
        }
    }
    Ok(())
}

/// P1: along three random directions the error of the central difference falls as h^2 until
/// round-off, whose size follows from the oracle's bound.
fn taylor<T: Subject>(
    subject: &T,
    x: &[Point3<f64>],
    gradient: &[Vector3<f64>],
    size: f64,
    draw: &mut Draw,
) -> Result<(), String> {
    for _ in 0..3 {
        let along: Vec<Vector3<f64>> = x.iter().map(|_| draw.direction()).collect();
        let slope: f64 = gradient.iter().zip(&along).map(|(g, d)| g.dot(d)).sum();
        let at = |h: f64| {
            subject.value(
                &x.iter()
                    .zip(&along)
                    .map(|(p, d)| p + d * h)
                    .collect::<Vec<_>>(),
            )
        };
        let duals: Vec<Point3<Dual>> = x.iter().map(|p| p.map(Dual::of)).collect();
        let rounding = subject.value(&duals).real.error;
        let reach = x.iter().map(|p| p.coords.amax()).fold(size, f64::max);
        let steep: f64 = gradient.iter().map(|g| g.norm()).sum();
        let mut previous: Option<f64> = None;
        for k in 6..16 {
            let h = size / f64::from(1 << k);
            let error = ((at(h) - at(-h)) / (2.0 * h) - slope).abs();
            // Rounding of C and of the points themselves, divided by the step.
            let floor = 8.0 * f64::EPSILON * (rounding + steep * reach) / h;
            if let Some(previous) = previous
                && previous > 64.0 * floor
                && !(error <= previous / 3.0)
            {
                return Err(format!(
                    "h = {h:e}: error {error:e} after {previous:e} does not fall as h^2"
                ));
            }
            if k == 15 && !(error <= 1e-3 * steep + 64.0 * floor) {
                return Err(format!("h = {h:e}: error {error:e}, slope {slope}"));
            }
            previous = Some(error);
        }
    }
    Ok(())
}

/// The whole suite for one kind: random positions and parameters, three scales, away from the
/// origin.
///
/// # Errors
/// The first failed check.
pub fn check_constraint<C: Spec<K>, const K: usize>(
    seed: u64,
    cases: usize,
) -> Result<(), Failure> {
    let mut draw = Draw::new(seed);
    for case in 0..cases {
        let points: [u32; K] = std::array::from_fn(|k| k as u32);
        let x = draw.shape(K);
        let parameters = draw.parameters(C::PARAMETERS);
        let kind = C::from_parameters(points, &parameters);
        let fail = |check, detail| Failure {
            subject: format!("{} case {case}", C::NAME),
            check,
            seed,
            detail,
        };
        translation(&kind, &x, &parameters)
            .map_err(|d| fail("translation, bit for bit (P3)", d))?;
        scaling(&kind, &x, &parameters).map_err(|d| fail("unit of length, bit for bit (P8)", d))?;
        balance::<C, K>(&kind, &x).map_err(|d| fail("forces and torques balance (P5, P6)", d))?;
        if C::kernel().has_unit_gradients() {
            let at = kind.value_and_gradient(&std::array::from_fn(|k| x[k]));
            at.map_or(Ok(()), |(_, g)| unit(&g))
                .map_err(|d| fail("gradients of length one", d))?;
        }
        rotation(&kind, &x, &parameters, &mut draw).map_err(|d| fail("rotation (P7)", d))?;
        for scale in [1e-3, 1.0, 1e3] {
            let offset = Vector3::from_fn(|_, _| draw.between(-4.0, 4.0) * scale);
            let moved: Vec<Point3<f64>> = x
                .iter()
                .map(|p| Point3::from(p.coords * scale + offset))
                .collect();
            let kind = C::from_parameters(
                points,
                &moved_parameters(C::PARAMETERS, &parameters, scale, &offset),
            );
            // Near the jump of an angle the difference quotient would straddle it: a declared kink.
            if C::DEGREE == 0 && kind.value(&std::array::from_fn(|k| moved[k])).abs() > 2.5 {
                continue;
            }
            check(C::NAME, &Fixed(kind), &moved, 0.1 * scale, &mut draw)?;
        }
    }
    Ok(())
}

/// Parameters of the same constraint after scaling and translation of space.
fn moved_parameters(
    kinds: &[Parameter],
    values: &[f64],
    scale: f64,
    offset: &Vector3<f64>,
) -> Vec<f64> {
    kinds
        .iter()
        .zip(values)
        .map(|(kind, value)| match kind {
            Parameter::Length | Parameter::Height => value * scale,
            Parameter::Volume => value * scale.powi(3),
            Parameter::Coordinate(axis) => value * scale + offset[*axis],
            Parameter::Angle | Parameter::Direction(_) | Parameter::Weight => *value,
        })
        .collect()
}

fn same_bits<const K: usize>(
    a: &Option<(f64, [Vector3<f64>; K])>,
    b: &Option<(f64, [Vector3<f64>; K])>,
) -> Result<(), String> {
    if a == b {
        Ok(())
    } else {
        Err(format!("{a:?} against {b:?}"))
    }
}

fn translation<C: Spec<K>, const K: usize>(
    kind: &C,
    x: &[Point3<f64>],
    parameters: &[f64],
) -> Result<(), String> {
    let offset = Vector3::new(f64::from(1 << 25), -f64::from(1 << 24), f64::from(1 << 23));
    let moved = C::from_parameters(
        kind.points(),
        &moved_parameters(C::PARAMETERS, parameters, 1.0, &offset),
    );
    let there = std::array::from_fn(|k| x[k] + offset);
    same_bits(
        &kind.value_and_gradient(&std::array::from_fn(|k| x[k])),
        &moved.value_and_gradient(&there),
    )
}

fn scaling<C: Spec<K>, const K: usize>(
    kind: &C,
    x: &[Point3<f64>],
    parameters: &[f64],
) -> Result<(), String> {
    let here = kind.value_and_gradient(&std::array::from_fn(|k| x[k]));
    for exponent in [-20, -10, 7, 20] {
        let scale = 2_f64.powi(exponent);
        let zero = Vector3::zeros();
        let scaled = C::from_parameters(
            kind.points(),
            &moved_parameters(C::PARAMETERS, parameters, scale, &zero),
        );
        let there =
            scaled.value_and_gradient(&std::array::from_fn(|k| Point3::from(x[k].coords * scale)));
        let back = there.map(|(c, g)| {
            (
                c * scale.powi(-C::DEGREE),
                g.map(|g| g * scale.powi(1 - C::DEGREE)),
            )
        });
        same_bits(&here, &back)?;
    }
    Ok(())
}

/// Checks that each gradient has length one up to rounding, as [`Constraint::UNIT`] declares.
fn unit(gradient: &[Vector3<f64>]) -> Result<(), String> {
    let off = |g: &Vector3<f64>| (g.norm() - 1.0).abs();
    match gradient.iter().find(|g| !(off(g) <= 4.0 * f64::EPSILON)) {
        Some(g) => Err(format!("{g:?} is {:e} off", off(g))),
        None => Ok(()),
    }
}

fn balance<C: Spec<K>, const K: usize>(kind: &C, x: &[Point3<f64>]) -> Result<(), String> {
    let places = C::PARAMETERS
        .iter()
        .any(|p| matches!(p, Parameter::Coordinate(_) | Parameter::Direction(_)));
    if places {
        // The reaction acts on the bone or the fixed position, which is no particle.
        return Ok(());
    }
    let Some((_, g)) = kind.value_and_gradient(&std::array::from_fn(|k| x[k])) else {
        return Err("undefined".into());
    };
    let force: Vector3<f64> = g.iter().sum();
    let size: f64 = g.iter().map(|g| g.norm()).sum();
    if !(force.norm() <= 4.0 * f64::EPSILON * size) {
        return Err(format!("sum of gradients {force:?} of {size}"));
    }
    let arms: Vec<Vector3<f64>> = x.iter().map(|p| p - x[0]).collect();
    let torque: Vector3<f64> = arms.iter().zip(&g).map(|(r, g)| r.cross(g)).sum();
    let size: f64 = arms.iter().zip(&g).map(|(r, g)| r.norm() * g.norm()).sum();
    if !(torque.norm() <= 16.0 * f64::EPSILON * size) {
        return Err(format!("sum of torques {torque:?} of {size}"));
    }
    Ok(())
}

fn rotation<C: Spec<K>, const K: usize>(
    kind: &C,
    x: &[Point3<f64>],
    parameters: &[f64],
    draw: &mut Draw,
) -> Result<(), String> {
    let r = draw.rotation();
    let mut turned = parameters.to_vec();
    for triple in 0..parameters.len().saturating_sub(2) {
        let is = |k: usize, p: Parameter| C::PARAMETERS[triple + k] == p;
        let place = (0..3).all(|k| is(k, Parameter::Coordinate(k)));
        let direction = (0..3).all(|k| is(k, Parameter::Direction(k)));
        if place || direction {
            let v = r * Vector3::from_fn(|k, _| parameters[triple + k]);
            (0..3).for_each(|k| turned[triple + k] = v[k]);
        }
    }
    let there = C::from_parameters(kind.points(), &turned);
    let y: [Point3<f64>; K] = std::array::from_fn(|k| r * x[k]);
    let duals: [Point3<Dual>; K] = std::array::from_fn(|k| x[k].map(Dual::of));
    let bound = MARGIN * f64::EPSILON * (kind.value(&duals).real.error + 16.0);
    let (Some((c, g)), Some((d, h))) = (
        kind.value_and_gradient(&std::array::from_fn(|k| x[k])),
        there.value_and_gradient(&y),
    ) else {
        return Err("undefined".into());
    };
    // An angle near pi can return as -pi: the same fold.
    let same = (c - d).abs() <= bound
        || (C::DEGREE == 0 && ((c - d).abs() - std::f64::consts::TAU).abs() <= bound);
    let steepest: f64 = g.iter().map(|g| g.norm()).sum();
    let shape = 1.0 + steepest * steepest;
    let turned = g
        .iter()
        .zip(&h)
        .all(|(g, h)| (r * g - h).norm() <= MARGIN * f64::EPSILON * shape * 16.0);
    if same && turned {
        Ok(())
    } else {
        Err(format!("C {c} and {d}, gradient {g:?} and {h:?}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constraints::{EnclosedVolume, ForEachKind, KINDS, for_each_kind};
    use crate::testing::{BrokenConstraint, CONTROLS, VolumeSubject};

    struct Conformance(Vec<&'static str>);
    impl ForEachKind for Conformance {
        fn visit<C: Spec<K>, const K: usize>(&mut self) {
            check_constraint::<C, K>(1, 256).unwrap_or_else(|f| panic!("{f}"));
            self.0.push(C::NAME);
        }
    }

    #[test]
    fn every_constraint_conforms() {
        let mut seen = Conformance(Vec::new());
        for_each_kind(&mut seen);
        assert_eq!(seen.0, KINDS);
    }

    struct Rejected;
    impl ForEachKind for Rejected {
        fn visit<C: Spec<K>, const K: usize>(&mut self) {
            let mut draw = Draw::new(2);
            let x = draw.shape(K);
            let mut parameters = draw.parameters(C::PARAMETERS);
            if C::DEGREE == 0 {
                parameters.fill(0.1);
            }
            let subject = Fixed(C::from_parameters(
                std::array::from_fn(|k| k as u32),
                &parameters,
            ));
            for &(control, how) in CONTROLS {
                let broken = BrokenConstraint { subject, how };
                let caught = check(C::NAME, &broken, &x, 0.1, &mut draw);
                assert!(
                    caught.is_err(),
                    "{}: control `{control}` was accepted",
                    C::NAME
                );
            }
        }
    }

    #[test]
    fn every_negative_control_is_rejected() {
        for_each_kind(&mut Rejected);
    }

    fn tetrahedron(size: f64) -> (VolumeSubject, Vec<Point3<f64>>) {
        let x = [
            [0.94, 0.0, -0.33],
            [-0.47, 0.81, -0.33],
            [-0.47, -0.81, -0.33],
            [0.0, 0.0, 1.0],
        ];
        let x = x.map(|p| Point3::from(Vector3::from(p) * size)).to_vec();
        let constraint = EnclosedVolume::new(
            &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
            4,
            0.4 * size.powi(3),
            0.0,
        );
        (
            VolumeSubject {
                constraint,
                count: 4,
            },
            x,
        )
    }

    #[test]
    fn enclosed_volume_conforms_and_its_controls_are_rejected() {
        let mut draw = Draw::new(3);
        for size in [1e-3, 1.0, 1e3] {
            let (subject, x) = tetrahedron(size);
            check("enclosed volume", &subject, &x, 0.1 * size, &mut draw)
                .unwrap_or_else(|f| panic!("{f}"));
            for &(control, how) in CONTROLS {
                let broken = BrokenConstraint {
                    subject: subject.clone(),
                    how,
                };
                assert!(
                    check("enclosed volume", &broken, &x, 0.1 * size, &mut draw).is_err(),
                    "control `{control}` was accepted at size {size}"
                );
            }
        }
    }

    #[test]
    fn gradients_that_are_not_of_length_one_are_rejected() {
        let g = Vector3::new(0.6, 0.0, -0.8);
        assert_eq!(unit(&[g, -g]), Ok(()));
        assert!(
            unit(&[g, g * (1.0 + 1e-14)]).is_err() && unit(&[Vector3::repeat(f64::NAN)]).is_err()
        );
    }

    #[test]
    fn a_gradient_of_a_millimetre_tetrahedron_that_is_zero_is_rejected() {
        // The usual relative error with a floor of 1 accepts it.
        let (subject, x) = tetrahedron(1e-3);
        let broken = BrokenConstraint {
            subject,
            how: |g| g.fill(Vector3::zeros()),
        };
        assert!(check("enclosed volume", &broken, &x, 1e-4, &mut Draw::new(4)).is_err());
    }
}
