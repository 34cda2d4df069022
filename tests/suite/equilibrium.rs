//! Equilibrium solvers: derivatives of the energy, invariants of the solution, obstacles, and
//! comparison of the solvers.

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use pliant::constraints::{
    Bending, Constraint, Distance, EnclosedVolume, Potential, Quadratic, for_each_kind,
};
use pliant::constraints::{ForEachKind, Spec};
use pliant::contact::ContactPlane;
use pliant::mesh::measures::{Aabb, volume};
use pliant::mesh::shapes::make;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::solvers::{
    ContactFilter, DescentSettings, Energy, FactorError, Newton, NoContact, QuasiStatic, stiffness,
};
use pliant::testing::Draw;
use pliant::testing::internals::constraints::Second;
use pliant::testing::internals::solvers::Factor;

use crate::tolerances::{T2, T3, T7, T15, worst};

/// Second derivatives of every kind of constraint, against differences of its analytic gradient.
struct Derivatives {
    draw: Draw,
    kinds: usize,
}

/// Largest error of a Hessian relative to central differences of the gradient with step `h`,
/// divided by its largest entry.
fn hessian_error<C: Constraint<K>, const K: usize>(
    c: &C,
    x: &[Point3<f64>; K],
    second: &Second<K>,
    h: f64,
) -> f64 {
    let gradient = |x: &[Point3<f64>; K]| c.value_and_gradient(x).expect("a regular shape").1;
    let size = worst(second.hessian.iter().flatten().map(|b| b.abs().max())).max(1.0);
    let mut errors = Vec::new();
    for j in 0..K {
        for axis in 0..3 {
            let at = |by: f64| {
                let mut moved = *x;
                moved[j][axis] += by;
                moved
            };
            let (above, below) = (gradient(&at(h)), gradient(&at(-h)));
            for i in 0..K {
                for r in 0..3 {
                    let difference = (above[i][r] - below[i][r]) / (2.0 * h);
                    errors.push((difference - second.hessian[i][j][(r, axis)]).abs() / size);
                }
            }
        }
    }
    worst(errors)
}

impl ForEachKind for Derivatives {
    fn visit<C: Spec<K>, const K: usize>(&mut self) {
        self.kinds += 1;
        let mut orders = Vec::new();
        for _ in 0..20 {
            let parameters = self.draw.parameters(C::PARAMETERS);
            let constraint = C::from_parameters(std::array::from_fn(|k| k as u32), &parameters);
            let x: [Point3<f64>; K] = self.draw.shape(K).try_into().expect("as many points");
            let (value, gradient) = constraint.value_and_gradient(&x).expect("a regular shape");
            let second = constraint.value(&Second::variables(&x));
            let steep = worst(gradient.iter().map(Vector3::norm)).max(1.0);
            let apart = worst(
                gradient
                    .iter()
                    .zip(&second.gradient)
                    .map(|(a, b)| (a - b).norm()),
            );
            // The gradient of a hinge is divided by heights of 0.1 and more, which increases
            // each rounding by the same factor.
            assert!(
                (second.value - value).abs() <= 100.0 * T2,
                "{}: value",
                C::NAME
            );
            assert!(
                apart <= 100.0 * T2 * steep,
                "{}: gradient off by {apart:e}",
                C::NAME
            );
            let [coarse, fine] = [1e-3, 5e-4].map(|h| hessian_error(&constraint, &x, &second, h));
            // A Hessian that is zero or belongs to a constraint of second degree has no error
            // that could fall.
            if coarse > 1e-9 {
                orders.push((coarse / fine).log2());
            }
            assert!(coarse <= 2e-2, "{}: Hessian off by {coarse:e}", C::NAME);
        }
        orders.sort_by(f64::total_cmp);
        if let Some(median) = orders.get(orders.len() / 2) {
            assert!((median - 2.0).abs() <= T3, "{}: order {median}", C::NAME);
        }
    }
}

#[test]
fn second_derivatives_of_every_constraint_are_those_of_its_gradient() {
    let mut all = Derivatives {
        draw: Draw::new(11),
        kinds: 0,
    };
    for_each_kind(&mut all);
    assert_eq!(all.kinds, pliant::constraints::KINDS.len());
    // Control: a Hessian with two exchanged points is detected.
    let hinge = pliant::constraints::Bending::new([0, 1, 2, 3], 0.3);
    let x: [Point3<f64>; 4] = Draw::new(3).shape(4).try_into().expect("four points");
    let mut wrong = hinge.value(&Second::variables(&x));
    wrong.hessian.swap(2, 3);
    assert!(!(hessian_error(&hinge, &x, &wrong, 5e-4) <= 2e-2));
}

/// A closed tube 2 m long with fixed vertices within 0.3 m of the ends.
struct Tube {
    mesh: TriangleMesh,
    inverse_mass: Vec<f64>,
}

impl Tube {
    fn new() -> Self {
        let mesh = make("tube").expect("a shape").mesh;
        let middle = mesh.bounding_box().center();
        let far = |p: &Point3<f64>| (*p - middle).amax() > 0.7;
        let inverse_mass = mesh
            .vertices
            .iter()
            .map(|p| if far(p) { 0.0 } else { 1.0 })
            .collect();
        Self { mesh, inverse_mass }
    }

    /// Springs of 300 N/m, hinges of 0.5 N m, a volume with some compliance.
    fn energy(&self, compliance: f64) -> Energy {
        let topology = Topology::new(&self.mesh);
        let (edges, k) = stiffness::edges(&self.mesh, &topology, 300.0);
        let (hinges, b) = stiffness::hinges(&self.mesh, &topology, 0.5);
        let count = self.mesh.vertices.len();
        Energy {
            elastic: vec![
                Box::new(Quadratic::<_, 2>::new(edges, k)),
                Box::new(Quadratic::<_, 4>::new(hinges, b)),
            ],
            volumes: vec![EnclosedVolume::new(
                &self.mesh.triangles,
                count,
                self.mesh.volume(),
                compliance,
            )],
            ..Energy::default()
        }
    }

    /// The fixed vertices: those of one half at their positions in `pose`, those of the other
    /// half unchanged.
    fn held(&self, pose: &Isometry3<f64>, both: bool) -> Vec<(u32, Point3<f64>)> {
        let middle = self.mesh.bounding_box().center();
        let along = self.mesh.bounding_box().extents().imax();
        let each = self
            .mesh
            .vertices
            .iter()
            .enumerate()
            .filter(|(v, _)| self.inverse_mass[*v] == 0.0);
        each.map(|(v, p)| {
            (
                v as u32,
                if both || p[along] > middle[along] {
                    pose * p
                } else {
                    *p
                },
            )
        })
        .collect()
    }

    fn quasi_static(
        &self,
        pose: &Isometry3<f64>,
        both: bool,
        compliance: f64,
        tolerance: f64,
    ) -> Vec<Point3<f64>> {
        let settings = DescentSettings {
            tolerance,
            iterations: 3000,
        };
        let energy = self.energy(compliance);
        let mut solver =
            QuasiStatic::new(energy, &self.mesh.vertices, &self.inverse_mass, settings)
                .expect("held");
        let mut x = self.mesh.vertices.clone();
        solver.follow(&mut x, &self.held(pose, both), &mut NoContact);
        let outcome = solver.solve(&mut x, &mut NoContact, |_, _| true);
        assert!(outcome.converged, "{outcome:?}");
        x
    }

    fn newton(&self, start: &[Point3<f64>], compliance: f64) -> Vec<Point3<f64>> {
        let settings = DescentSettings {
            tolerance: 1e-10,
            iterations: 60,
        };
        let energy = self.energy(compliance);
        let mut solver =
            Newton::new(energy, &self.mesh.vertices, &self.inverse_mass, settings).expect("memory");
        let mut x = start.to_vec();
        let outcome = solver
            .solve(&mut x, &mut NoContact, |_, _| true)
            .expect("held");
        assert!(outcome.converged, "{outcome:?}");
        x
    }
}

fn bent() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_euler_angles(0.2, 0.3, 0.25);
    Isometry3::from_parts(Translation3::new(0.05, -0.1, 0.08), turn)
}

fn apart(a: &[Point3<f64>], b: &[Point3<f64>]) -> f64 {
    worst(a.iter().zip(b).map(|(a, b)| (a - b).norm()))
}

#[test]
fn two_solvers_find_one_equilibrium_and_keep_the_volume() {
    let tube = Tube::new();
    let length = tube.mesh.length();
    for compliance in [0.0, 1e-6] {
        let quasi_static = tube.quasi_static(&bent(), false, compliance, 1e-9);
        let newton = tube.newton(
            &tube.quasi_static(&bent(), false, compliance, 1e-2),
            compliance,
        );
        let off = apart(&quasi_static, &newton);
        assert!(
            off <= T15 * length,
            "compliance {compliance}: {off:e} m apart"
        );
        // Control: a solution stopped early is further away.
        let early = tube.quasi_static(&bent(), false, compliance, 1e-3);
        assert!(!(apart(&early, &newton) <= T15 * length));
        let ratio = volume(&newton, &tube.mesh.triangles) / tube.mesh.volume();
        if compliance == 0.0 {
            assert!((ratio - 1.0).abs() <= T7, "volume off by {:e}", ratio - 1.0);
        } else {
            assert!((ratio - 1.0).abs() > 1e-9, "a compliant volume gives way");
        }
    }
}

#[test]
fn a_body_carried_rigidly_is_not_deformed() {
    let tube = Tube::new();
    let carried: Vec<Point3<f64>> = tube.mesh.vertices.iter().map(|p| bent() * p).collect();
    let x = tube.quasi_static(&bent(), true, 0.0, 1e-11);
    let off = apart(&x, &carried);
    assert!(
        off <= T15 * tube.mesh.length(),
        "{off:e} m from the carried shape"
    );
    assert!(
        !(apart(&x, &tube.mesh.vertices) <= T15),
        "control: it was carried"
    );
}

#[test]
fn an_equilibrium_has_the_same_bits_for_any_number_of_threads() {
    let tube = Tube::new();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| tube.quasi_static(&bent(), false, 0.0, 1e-4))
    };
    let one = run(1);
    assert!([2, 8].into_iter().all(|threads| run(threads) == one));
    assert!(
        tube.quasi_static(&bent(), false, 0.0, 1e-5) != one,
        "control: another tolerance has other bits"
    );
}

/// A floor at a height, as an obstacle for single vertices.
pub struct Floor {
    pub vertices: u32,
    pub height: f64,
    pub is_stopped: bool,
}

impl ContactFilter for Floor {
    fn planes(&self) -> Vec<ContactPlane> {
        let origin = Point3::new(0.0, self.height, 0.0);
        let row = |v| ContactPlane {
            terms: [(v, 1.0), (v, 0.0), (v, 0.0), (v, 0.0)],
            normal: Vector3::y(),
            origin,
            distance: 0.0,
        };
        (0..self.vertices).map(row).collect()
    }
    fn touching(&self) -> f64 {
        1e-9
    }
    fn push(&mut self, _: &[Point3<f64>], x: &mut [Point3<f64>]) {
        x.iter_mut().for_each(|p| p.y = p.y.max(self.height));
    }
    fn is_stopped(&self) -> bool {
        self.is_stopped
    }
    fn accept(&mut self, _: &[Point3<f64>]) {}
}

#[test]
fn a_tube_on_a_floor_balances_its_weight() {
    let tube = Tube::new();
    let bottom = tube.mesh.bounding_box().min.y;
    let mut floor = Floor {
        vertices: tube.inverse_mass.len() as u32,
        height: bottom - 0.01,
        is_stopped: false,
    };
    let weight = Vector3::new(0.0, -0.2, 0.0);
    let energy = || Energy {
        forces: vec![weight; tube.mesh.vertices.len()],
        ..tube.energy(1e-6)
    };
    let settings = DescentSettings {
        tolerance: 1e-9,
        iterations: 3000,
    };
    let mut x = tube.mesh.vertices.clone();
    let mut solver =
        QuasiStatic::new(energy(), &x.clone(), &tube.inverse_mass, settings).expect("held");
    // A stop is heard within a trial, and not only between two iterations.
    floor.is_stopped = true;
    let stopped = solver.solve(&mut x.clone(), &mut floor, |_, _| true);
    assert_eq!((stopped.iterations, stopped.evaluations), (0, 1));
    floor.is_stopped = false;
    let outcome = solver.solve(&mut x, &mut floor, |_, _| true);
    assert!(outcome.converged, "{outcome:?}");
    let down: Vec<usize> = (0..x.len())
        .filter(|v| x[*v].y <= floor.height && tube.inverse_mass[*v] > 0.0)
        .collect();
    assert!(down.len() >= 3, "{} vertices touch the floor", down.len());
    assert!(x.iter().all(|p| p.y >= floor.height));
    // The load on the floor: the force on each touching vertex points down, and on all others it
    // is zero.
    let mut gradient = vec![Vector3::zeros(); x.len()];
    let energy_at = energy();
    energy_at.value_and_gradient(&x, &mut gradient);
    let (_, area) = energy_at.volumes[0].value_and_gradient(&x);
    let force = |v: usize| -(gradient[v] - area[v] * outcome.pressure);
    for v in (0..x.len()).filter(|v| tube.inverse_mass[*v] > 0.0) {
        let scale = 1e-6 * solver.problem.force_scale();
        if down.contains(&v) {
            assert!(
                force(v).y <= scale && force(v).xz().norm() <= scale,
                "vertex {v}: {}",
                force(v)
            );
        } else {
            assert!(force(v).norm() <= scale, "vertex {v}: {}", force(v));
        }
    }
    // Newton's method finds the same load by another way.
    let settings = DescentSettings {
        tolerance: 1e-11,
        iterations: 100,
    };
    let mut newton = Newton::new(energy(), &x, &tube.inverse_mass, settings).expect("memory");
    let mut exact = tube.mesh.vertices.clone();
    let found = newton.solve(&mut exact, &mut floor, |_, _| true);
    let found = found.expect("held");
    println!(
        "floor: {} iterations, residual {:e}",
        found.iterations, found.residual
    );
    assert!(found.converged, "{found:?}");
    let off = apart(&x, &exact);
    assert!(off <= T15 * tube.mesh.length(), "{off:e} m apart");
    assert!(exact.iter().all(|p| p.y >= floor.height));
    // Without a floor the body hangs lower.
    let mut free = tube.mesh.vertices.clone();
    assert!(
        solver
            .solve(&mut free, &mut NoContact, |_, _| true)
            .converged
    );
    assert!(
        free.iter().any(|p| p.y < floor.height - 1e-3),
        "control: the floor bears nothing"
    );
}

/// A ball, as an obstacle for single vertices.
struct Ball {
    centre: Point3<f64>,
    radius: f64,
    x: Vec<Point3<f64>>,
}

impl ContactFilter for Ball {
    fn planes(&self) -> Vec<ContactPlane> {
        let row = |(v, x): (usize, &Point3<f64>)| ContactPlane {
            terms: [(v as u32, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)],
            normal: (x - self.centre).normalize(),
            origin: self.centre,
            distance: self.radius,
        };
        self.x.iter().enumerate().map(row).collect()
    }
    fn touching(&self) -> f64 {
        1e-9
    }
    fn push(&mut self, _: &[Point3<f64>], x: &mut [Point3<f64>]) {
        for p in x {
            let from = *p - self.centre;
            if from.norm() < self.radius {
                *p = self.centre + from * (self.radius / from.norm());
            }
        }
    }
    fn accept(&mut self, x: &[Point3<f64>]) {
        self.x = x.to_vec();
    }
}

#[test]
fn a_tube_over_a_ball_has_one_equilibrium_by_both_solvers() {
    let tube = Tube::new();
    let bounds = tube.mesh.bounding_box();
    let radius = 0.5 * bounds.extents().x;
    let mut ball = Ball {
        centre: Point3::new(
            bounds.center().x,
            bounds.min.y - radius - 0.005,
            bounds.center().z,
        ),
        radius,
        x: tube.mesh.vertices.clone(),
    };
    let weight = Vector3::new(0.0, -0.2, 0.0);
    let energy = || Energy {
        forces: vec![weight; tube.mesh.vertices.len()],
        ..tube.energy(1e-6)
    };
    let solved = |tolerance: f64, ball: &mut Ball| {
        let settings = DescentSettings {
            tolerance,
            iterations: 5000,
        };
        let mut x = tube.mesh.vertices.clone();
        ball.x.clone_from(&x);
        let mut solver =
            QuasiStatic::new(energy(), &x.clone(), &tube.inverse_mass, settings).expect("held");
        let outcome = solver.solve(&mut x, ball, |_, _| true);
        assert!(outcome.converged, "{outcome:?}");
        x
    };
    let x = solved(1e-7, &mut ball);
    let settings = DescentSettings {
        tolerance: 1e-10,
        iterations: 200,
    };
    let mut newton = Newton::new(energy(), &x, &tube.inverse_mass, settings).expect("memory");
    let mut exact = tube.mesh.vertices.clone();
    ball.x.clone_from(&exact);
    let found = newton.solve(&mut exact, &mut ball, |_, _| true);
    let found = found.expect("held");
    let (centre, radius) = (ball.centre, ball.radius);
    let height = |p: &Point3<f64>| (p - centre).norm() - radius;
    let touching = exact.iter().filter(|p| height(p) <= 1e-9).count();
    let off = apart(&x, &exact);
    println!(
        "ball: {} iterations, residual {:e}, {touching} vertices touch, {off:e} m apart",
        found.iterations, found.residual
    );
    assert!(found.converged, "{found:?}");
    assert!(touching >= 3, "{touching}");
    let rounded = 8.0 * f64::EPSILON * (ball.radius + ball.centre.coords.norm());
    assert!(exact.iter().all(|p| height(p) >= -rounded));
    assert!(off <= T15 * tube.mesh.length(), "{off:e} m apart");
    // Controls: a solution stopped early is further away, and without the ball the tube hangs lower.
    let early = solved(1e-3, &mut ball);
    assert!(!(apart(&early, &exact) <= T15 * tube.mesh.length()));
    let mut free = tube.mesh.vertices.clone();
    let found = newton.solve(&mut free, &mut NoContact, |_, _| true);
    assert!(found.expect("held").converged);
    assert!(free.iter().any(|p| height(p) < -1e-3));
}

/// Two vertices that stay a distance apart along y.
struct Gap(f64);

impl ContactFilter for Gap {
    fn planes(&self) -> Vec<ContactPlane> {
        vec![ContactPlane {
            terms: [(2, 1.0), (1, -1.0), (0, 0.0), (0, 0.0)],
            normal: Vector3::y(),
            origin: Point3::origin(),
            distance: self.0,
        }]
    }
    fn touching(&self) -> f64 {
        1e-9
    }
    fn push(&mut self, _: &[Point3<f64>], x: &mut [Point3<f64>]) {
        let lack = self.0 - (x[2].y - x[1].y);
        if lack > 0.0 {
            x[2].y += 0.5 * lack;
            x[1].y -= 0.5 * lack;
        }
    }
    fn accept(&mut self, _: &[Point3<f64>]) {}
}

#[test]
fn parts_that_push_each_other_share_the_load_by_their_stiffness() {
    // Held at y = 0 and 4, springs of 300 and 100 N/m and 1 m, and a gap of 0.5 m between their
    // ends at 1 and 3, which a force of 250 N closes from above.
    let heights = [0.0, 1.0, 3.0, 4.0];
    let x = heights.map(|y| Point3::new(0.0, y, 0.0)).to_vec();
    let spring = |points| Distance { points, rest: 1.0 };
    let energy = || Energy {
        elastic: vec![Box::new(Quadratic::<_, 2>::new(
            vec![spring([0, 1]), spring([2, 3])],
            vec![300.0, 100.0],
        ))],
        forces: [0.0, 0.0, -250.0, 0.0].map(|f| Vector3::y() * f).to_vec(),
        ..Energy::default()
    };
    let inverse_mass = [0.0, 1.0, 1.0, 0.0];
    let settings = DescentSettings {
        tolerance: 1e-12,
        iterations: 50,
    };
    // Equal motion from where they touch: 250 = 100 (1.5 + d) + 300 d.
    let d = (250.0 - 150.0) / 400.0;
    let mut newton = Newton::new(energy(), &x, &inverse_mass, settings).expect("memory");
    let mut end = x.clone();
    let found = newton.solve(&mut end, &mut Gap(0.5), |_, _| true);
    let found = found.expect("held");
    assert!(found.converged && found.iterations <= 3, "{found:?}");
    assert!((end[1].y - (1.0 - d)).abs() <= 1e-12, "{}", end[1].y);
    assert!((end[2].y - (1.5 - d)).abs() <= 1e-12, "{}", end[2].y);
    // Control: without the row the upper one goes past the lower one.
    let mut past = x.clone();
    let found = newton.solve(&mut past, &mut NoContact, |_, _| true);
    assert!(found.expect("held").converged);
    assert!((past[2].y - 0.5).abs() <= 1e-12, "{}", past[2].y);
}

/// The greatest motion of a trial, relative to the diagonal of the box around where it began.
struct Farthest(f64);

impl ContactFilter for Farthest {
    fn planes(&self) -> Vec<ContactPlane> {
        Vec::new()
    }
    fn touching(&self) -> f64 {
        0.0
    }
    fn push(&mut self, start: &[Point3<f64>], x: &mut [Point3<f64>]) {
        let size = Aabb::of_points(start).extents().norm();
        self.0 = worst([self.0, apart(start, x) / size]);
    }
    fn accept(&mut self, _: &[Point3<f64>]) {}
}

/// A spring of 1 m carries 10,000 times the force that would double its length. The first direction is as long.
#[test]
fn no_trial_leaves_the_scene() {
    let mut x = [Point3::origin(), Point3::new(0.0, 0.0, -1.0)];
    let spring = Distance {
        points: [0, 1],
        rest: 1.0,
    };
    let energy = Energy {
        elastic: vec![Box::new(Quadratic::<_, 2>::new(vec![spring], vec![1e-3]))],
        forces: vec![Vector3::zeros(), Vector3::new(0.0, 0.0, -10.0)],
        ..Energy::default()
    };
    let settings = DescentSettings {
        tolerance: 1e-9,
        iterations: 200,
    };
    let mut solver = QuasiStatic::new(energy, &x, &[0.0, 1.0], settings).expect("one end is held");
    let mut trials = Farthest(0.0);
    let outcome = solver.solve(&mut x, &mut trials, |_, _| true);
    assert!(outcome.converged, "{outcome:?}");
    assert!((x[1].z + 10_001.0).abs() <= 1e-4, "{x:?}");
    assert!(trials.0 > 0.4 && trials.0 <= 0.5 + 1e-9, "{}", trials.0);
}

#[test]
fn what_nothing_holds_is_an_error() {
    let tube = Tube::new();
    let free = vec![1.0; tube.mesh.vertices.len()];
    let made = QuasiStatic::new(
        tube.energy(0.0),
        &tube.mesh.vertices,
        &free,
        DescentSettings::default(),
    );
    assert!(matches!(
        made.err(),
        Some(FactorError::NotPositiveDefinite { .. })
    ));
}

#[test]
fn a_factor_solves_and_tells_what_is_not_positive_definite() {
    let mut draw = Draw::new(5);
    let (n, pairs) = (
        40_u32,
        (0..39)
            .map(|i| [i, i + 1])
            .chain([[0, 20], [7, 33]])
            .collect::<Vec<_>>(),
    );
    let mut factor = Factor::<3>::new(n as usize, &pairs).expect("memory");
    let mut dense = nalgebra::DMatrix::<f64>::zeros(120, 120);
    let mut add = |i: u32, j: u32, block: Matrix3<f64>, factor: &mut Factor<3>| {
        factor.add(
            i,
            j,
            &std::array::from_fn(|c| std::array::from_fn(|r| block[(r, c)])),
        );
        let (r, c) = (3 * i as usize, 3 * j as usize);
        dense.view_mut((r, c), (3, 3)).copy_from(&block);
        dense.view_mut((c, r), (3, 3)).copy_from(&block.transpose());
    };
    for &[a, b] in &pairs {
        add(
            b,
            a,
            Matrix3::from_fn(|_, _| draw.between(-1.0, 1.0)),
            &mut factor,
        );
    }
    (0..n).for_each(|i| add(i, i, Matrix3::from_diagonal_element(20.0), &mut factor));
    factor.factorise().expect("diagonally dominant");
    let right = nalgebra::DMatrix::<f64>::from_fn(120, 2, |_, _| draw.between(-1.0, 1.0));
    let mut found = right.as_slice().to_vec();
    factor.solve(&mut found, 2);
    let left = &dense * nalgebra::DMatrix::from_column_slice(120, 2, &found) - &right;
    assert!(left.amax() <= T7, "residual {:e}", left.amax());
    factor.add_diagonal(17, -100.0);
    assert!(matches!(
        factor.factorise(),
        Err(FactorError::NotPositiveDefinite { .. })
    ));
    factor.add_diagonal(17, f64::NAN);
    assert!(factor.factorise().is_err());
}

/// Two tubes side by side, the second moved by `apart` [m]. Springs of `joined` [N/m] connect
/// vertices of the same number. `shares` gives the conserved share of the volume of each tube.
fn two_tubes(
    apart: f64,
    joined: f64,
    shares: [f64; 2],
    away: f64,
) -> (Energy, Vec<Point3<f64>>, Vec<f64>) {
    let mut tube = Tube::new();
    tube.mesh
        .vertices
        .iter_mut()
        .for_each(|p| *p += Vector3::repeat(away));
    let count = tube.mesh.vertices.len() as u32;
    let second = |[a, b]: [u32; 2]| [a + count, b + count];
    let topology = Topology::new(&tube.mesh);
    let (edges, k) = stiffness::edges(&tube.mesh, &topology, 300.0);
    let both = edges.iter().copied().chain(edges.iter().map(|e| Distance {
        points: second(e.points),
        ..*e
    }));
    let between = (0..count).map(|v| Distance {
        points: [v, v + count],
        rest: apart,
    });
    let stiffness = [k.clone(), k, vec![joined; count as usize]].concat();
    let aside = Vector3::z() * apart;
    let x: Vec<Point3<f64>> = tube
        .mesh
        .vertices
        .iter()
        .copied()
        .chain(tube.mesh.vertices.iter().map(|p| p + aside))
        .collect();
    let triangles: Vec<[u32; 3]> = tube
        .mesh
        .triangles
        .iter()
        .map(|t| t.map(|v| v + count))
        .collect();
    let volumes = [&tube.mesh.triangles, &triangles].into_iter().zip(shares);
    let volumes = volumes
        .map(|(t, share)| EnclosedVolume::new(t, x.len(), share * tube.mesh.volume(), 0.0))
        .collect();
    let (hinges, b) = stiffness::hinges(&tube.mesh, &topology, 0.5);
    let more = hinges.iter().map(|h| Bending {
        points: h.points.map(|v| v + count),
        ..*h
    });
    let hinges = hinges.iter().copied().chain(more).collect();
    let springs = Quadratic::<_, 2>::new(both.chain(between).collect(), stiffness);
    let elastic: Vec<Box<dyn Potential>> = vec![
        Box::new(springs),
        Box::new(Quadratic::<_, 4>::new(hinges, b.repeat(2))),
    ];
    let inverse_mass = tube.inverse_mass.repeat(2);
    (
        Energy {
            elastic,
            volumes,
            ..Energy::default()
        },
        x,
        inverse_mass,
    )
}

#[test]
fn several_volumes_are_kept_at_once() {
    let shares = [1.1, 0.97];
    let tube = Tube::new();
    let settings = DescentSettings {
        tolerance: 1e-9,
        iterations: 5000,
    };
    let solve = |joined: f64| {
        let (energy, mut x, inverse_mass) = two_tubes(1.0, joined, shares, 0.0);
        let start = x.clone();
        // Newton's method continues from the result of the other solver, which conserves volumes
        // from the first step on.
        let mut first = QuasiStatic::new(energy, &x, &inverse_mass, settings).expect("held");
        assert!(first.solve(&mut x, &mut NoContact, |_, _| true).converged);
        let kept = |x: &[Point3<f64>]| -> Vec<f64> {
            let (one, two) = x.split_at(x.len() / 2);
            [one, two]
                .map(|x| volume(x, &tube.mesh.triangles) / tube.mesh.volume())
                .to_vec()
        };
        assert!(worst(kept(&x).iter().zip(shares).map(|(a, b)| (a - b).abs())) <= T2);
        let quasi = x.clone();
        let (energy, ..) = two_tubes(1.0, joined, shares, 0.0);
        let mut newton = Newton::new(energy, &start, &inverse_mass, settings).expect("held");
        let outcome = newton
            .solve(&mut x, &mut NoContact, |_, _| true)
            .expect("a factor");
        assert!(outcome.converged, "{outcome:?}");
        assert!(worst(kept(&x).iter().zip(shares).map(|(a, b)| (a - b).abs())) <= T2);
        assert!(
            worst(quasi.iter().zip(&x).map(|(a, b)| (a - b).norm())) <= T15 * tube.mesh.length()
        );
        assert!(
            newton.pressures[0] > 0.0 && newton.pressures[1] < 0.0,
            "{:?}",
            newton.pressures
        );
        (x, newton.pressures)
    };
    let (apart, free) = solve(0.0);
    let (joined, pressed) = solve(3.0);
    // Connected tubes affect each other.
    assert!(
        (free[0] - pressed[0]).abs() > 1e-3 * free[0],
        "{free:?}, {pressed:?}"
    );
    assert!(worst(apart.iter().zip(&joined).map(|(a, b)| (a - b).norm())) > 1e-4);
    // Each unconnected tube behaves as if alone.
    let (mut energy, mut x, inverse_mass) = two_tubes(1.0, 0.0, shares, 0.0);
    energy.volumes.truncate(1);
    let mut newton = Newton::new(energy, &x.clone(), &inverse_mass, settings).expect("held");
    x.copy_from_slice(&apart);
    assert!(
        newton
            .solve(&mut x, &mut NoContact, |_, _| true)
            .expect("a factor")
            .converged
    );
    assert!(
        (newton.pressures[0] / free[0] - 1.0).abs() <= 1e-4,
        "{free:?}, {:?}",
        newton.pressures
    );
}

#[test]
fn several_volumes_are_kept_far_from_the_origin() {
    // One volume is known there only to more than its own rounding error. A search with a
    // smaller tolerance finds nothing.
    let pressures = [0.0, 50.0].map(|away| {
        let (energy, mut x, inverse_mass) = two_tubes(1.0, 3.0, [1.1, 0.97], away);
        let settings = DescentSettings {
            tolerance: 1e-8,
            iterations: 3000,
        };
        let mut solver =
            QuasiStatic::new(energy, &x.clone(), &inverse_mass, settings).expect("held");
        let outcome = solver.solve(&mut x, &mut NoContact, |_, _| true);
        assert!(outcome.converged, "{away} m: {outcome:?}");
        solver.pressures[0]
    });
    assert!(
        (pressures[1] / pressures[0] - 1.0).abs() <= 1e-4,
        "{pressures:?}"
    );
}
