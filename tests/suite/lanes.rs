//! Any number of lanes gives the bits of scalar computation (P42), for ordinary and degenerate
//! input.

use nalgebra::{Point3, Vector3};
use pliant::Particles;
use pliant::constraints::{
    Batch, Bending, Constraint, Distance, EnclosedVolume, Project, Scalar, SweepOrder,
};
use pliant::mesh::shapes::icosphere;
use pliant::testing::Draw;
use pliant::testing::internals::constraints::{Kernel, MOST_NUMBERS, Periodic};
use pliant::testing::internals::constraints::{Lane, LaneConstraint, Several, SimdWidth};

use crate::bodies::{bits, edges, finite, hinges};

const DT: f64 = 0.01;

/// A randomly displaced sphere: an eighth of it fixed, edges without length, triangles without
/// area, flat hinges, folds.
fn odd_body() -> (pliant::mesh::TriangleMesh, Particles) {
    let mesh = icosphere(1.0, 4);
    let mut draw = Draw::new(4242);
    let mut x: Vec<Point3<f64>> = mesh
        .vertices
        .iter()
        .map(|p| p + draw.direction() * 0.02)
        .collect();
    for (t, &[a, b, c]) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = [a, b, c].map(|v| v as usize);
        match t % 97 {
            0 => x[b] = x[a],
            13 => x[c] = x[a] + (x[b] - x[a]) * 0.5,
            29 => x[c] = Point3::from(x[c].coords * 0.7),
            // Exactly flat.
            41 => [a, b, c].into_iter().for_each(|v| x[v].z = 0.5),
            _ => (),
        }
    }
    let inverse_mass = mesh.vertices.iter().enumerate();
    let inverse_mass = inverse_mass
        .map(|(i, p)| {
            if p.x > 0.75 {
                0.0
            } else {
                1.0 + (i % 7) as f64
            }
        })
        .collect();
    (mesh, Particles::at_rest(x, inverse_mass))
}

/// Compliances of all kinds, including zero and infinity.
fn compliance(count: usize) -> Vec<f64> {
    (0..count)
        .map(|i| [0.0, 1e-6, 1e-2, f64::INFINITY, 3.0][i % 5])
        .collect()
}

/// The complete result of a sweep, as bits.
#[derive(PartialEq)]
struct Left {
    particles: Vec<u64>,
    multipliers: Vec<u64>,
    skipped: u64,
}

fn swept<C: Constraint<K>, const K: usize>(
    all: &[C],
    body: &Particles,
    width: SimdWidth,
) -> (Left, Vec<C>) {
    let factors: Vec<f64> = (0..all.len()).map(|i| [1.0, 0.3, 0.0][i % 3]).collect();
    let compliance = compliance(all.len());
    let batch = Batch::new(
        all.to_vec(),
        compliance,
        SweepOrder::Coloured,
        body.len(),
        &[],
    );
    let mut batch = batch.with_relaxation(&factors).with_width(width);
    let mut particles = body.clone();
    for step in 0..4 {
        if step == 2 {
            batch.begin_step();
        }
        batch.project(&mut particles, DT);
    }
    assert!(finite(&particles));
    let multipliers = batch.multipliers().iter().map(|m| m.to_bits()).collect();
    (
        Left {
            particles: bits(&particles),
            multipliers,
            skipped: batch.usage().skipped,
        },
        batch.constraints(),
    )
}

/// Whether all widths give the scalar result; then the numbers of skipped projections and of
/// constraints.
fn same<C: Constraint<K> + PartialEq, const K: usize>(
    all: &[C],
    body: &Particles,
) -> (bool, u64, Vec<C>) {
    let (one, constraints) = swept(all, body, SimdWidth::One);
    let others = SimdWidth::available()
        .iter()
        .map(|&width| swept(all, body, width));
    let same = others
        .into_iter()
        .all(|(left, then)| left == one && then == constraints);
    (same, one.skipped, constraints)
}

#[test]
fn p42_lanes_change_no_bit_of_edges() {
    let (mesh, body) = odd_body();
    let mut all = edges(&mesh);
    // The last places of a colour: fewer than the lanes, with a particle twice in one
    // constraint.
    let (same_bits, skipped, _) = same(&all, &body);
    assert!(same_bits);
    assert!(
        skipped > 4,
        "no edge without length or mass: the test would show little"
    );
    all.push(Distance {
        points: [5, 5],
        rest: 0.1,
    });
    assert!(same(&all, &body).0, "an edge from a particle to itself");
}

#[test]
fn p42_lanes_change_no_bit_of_hinges() {
    let (mesh, body) = odd_body();
    let mut all = hinges(&mesh);
    for (i, hinge) in all.iter_mut().enumerate() {
        // Some hinges start after whole turns, some start from the other side.
        hinge.last = [0.0, 0.0, 0.0, 7.0, -9.5][i % 5] * f64::from(i % 61 < 20);
    }
    let (same_bits, skipped, then) = same(&all, &body);
    assert!(same_bits);
    assert!(
        skipped > 4,
        "no degenerate hinge and none held: the test would show little"
    );
    assert!(
        then.iter().any(|h| h.last.abs() > std::f64::consts::PI),
        "no angle beyond half a turn"
    );
    let [a, b, c, _] = all[0].points;
    all.push(Bending::new([a, b, c, c], 0.5));
    assert!(same(&all, &body).0, "both tips are one particle");
}

#[test]
fn p42_lanes_change_no_bit_of_ordinary_bodies() {
    // Ordinary input: all groups are computed in lanes, and every size leaves a remainder.
    for level in [0, 1, 3] {
        let mesh = icosphere(0.1, level);
        let mut draw = Draw::new(7);
        let x = mesh
            .vertices
            .iter()
            .map(|p| p + draw.direction() * 2e-4)
            .collect();
        let body = Particles::at_rest(x, vec![2.0; mesh.vertices.len()]);
        let (stretch, bending) = (same(&edges(&mesh), &body), same(&hinges(&mesh), &body));
        assert!(stretch.0 && bending.0, "level {level}");
        assert_eq!((stretch.1, bending.1), (0, 0));
    }
}

#[test]
fn p42_lanes_change_no_bit_of_extreme_sizes() {
    let (mesh, body) = odd_body();
    for scale in [1e-150, 1e-90, 1e-3, 1e3, 1e60] {
        let x: Vec<Point3<f64>> = body.position.iter().map(|p| p * scale).collect();
        let body = Particles::at_rest(x, body.inverse_mass.clone());
        let stretch: Vec<Distance> = edges(&mesh)
            .iter()
            .map(|e| Distance {
                rest: e.rest * scale,
                ..*e
            })
            .collect();
        assert!(same(&stretch, &body).0, "scale {scale:e}");
    }
    for scale in [1e-30, 1e-3, 1e3, 1e30] {
        let x: Vec<Point3<f64>> = body.position.iter().map(|p| p * scale).collect();
        let body = Particles::at_rest(x, body.inverse_mass.clone());
        let (left, _) = swept(&hinges(&mesh), &body, SimdWidth::One);
        for &width in SimdWidth::available() {
            assert!(
                swept(&hinges(&mesh), &body, width).0 == left,
                "scale {scale:e}, {width}"
            );
        }
    }
}

#[test]
fn p42_lanes_change_no_bit_of_the_volume() {
    let (mesh, body) = odd_body();
    let run = |width: SimdWidth| {
        let count = mesh.vertices.len();
        let mut volume = EnclosedVolume::new(&mesh.triangles, count, 0.93 * mesh.volume(), 1e-7)
            .with_width(width);
        let mut particles = body.clone();
        for _ in 0..3 {
            volume
                .project(&mut particles, DT)
                .expect("a sphere can be inflated");
        }
        bits(&particles)
    };
    let one = run(SimdWidth::One);
    assert!(
        SimdWidth::available()
            .iter()
            .all(|&width| run(width) == one)
    );
    assert!(one != bits(&body));
}

/// A hinge without its form in lanes, and without its branch where `ON_BRANCH` is false.
#[derive(Clone, Copy, PartialEq)]
struct OneByOne<const ON_BRANCH: bool>(Bending);

impl<const ON_BRANCH: bool> Constraint<4> for OneByOne<ON_BRANCH> {
    fn points(&self) -> [u32; 4] {
        self.0.points
    }
    fn value<S: Scalar>(&self, x: &[Point3<S>; 4]) -> S {
        self.0.value(x)
    }
    fn value_and_gradient(&self, x: &[Point3<f64>; 4]) -> Option<(f64, [Vector3<f64>; 4])> {
        self.0.value_and_gradient(x)
    }
    fn kernel() -> Kernel<Self, 4> {
        if ON_BRANCH {
            Kernel::periodic()
        } else {
            Kernel::one_by_one()
        }
    }
}

impl<const ON_BRANCH: bool> Periodic<4> for OneByOne<ON_BRANCH> {
    fn branch(&self) -> f64 {
        self.0.branch()
    }
    fn set_branch(&mut self, branch: f64) {
        self.0.set_branch(branch);
    }
    fn branch_of(&self, value: f64) -> f64 {
        self.0.branch_of(value)
    }
}

/// What hinges leave without lanes, and their branches then.
fn without_lanes<const ON_BRANCH: bool>(all: &[Bending], body: &Particles) -> (Left, Vec<Bending>) {
    let all: Vec<OneByOne<ON_BRANCH>> = all.iter().copied().map(OneByOne).collect();
    let (left, then) = swept(&all, body, SimdWidth::best());
    (left, then.into_iter().map(|hinge| hinge.0).collect())
}

#[test]
fn a_hinge_one_by_one_on_its_branch_leaves_the_bits_of_lanes() {
    let (mesh, body) = odd_body();
    let all = hinges(&mesh);
    let (lanes, then) = swept(&all, &body, SimdWidth::best());
    let (left, branches) = without_lanes::<true>(&all, &body);
    // A hinge of fixed points has no correction. One by one it stores no branch.
    let moves = |hinge: &Bending| {
        let mut points = hinge.points.iter();
        points.any(|&p| body.inverse_mass[p as usize] > 0.0)
    };
    let moving =
        |hinges: &[Bending]| -> Vec<Bending> { hinges.iter().copied().filter(moves).collect() };
    assert!(left == lanes && moving(&branches) == moving(&then));
    let (left, branches) = without_lanes::<false>(&all, &body);
    assert!(
        moving(&branches) != moving(&then),
        "control: without a branch none is stored"
    );
    assert!(
        left != lanes,
        "control: some hinge went through half a turn"
    );
}

/// A distance whose form in lanes differs from the scalar form. The comparison must detect it.
#[derive(Clone, Copy, PartialEq)]
struct Wrong<const HOW: usize>(Distance);

impl<const HOW: usize> Constraint<2> for Wrong<HOW> {
    const NAME: &'static str = "wrong";

    fn points(&self) -> [u32; 2] {
        self.0.points
    }
    fn value<S: Scalar>(&self, x: &[Point3<S>; 2]) -> S {
        self.0.value(x)
    }
    fn value_and_gradient(&self, x: &[Point3<f64>; 2]) -> Option<(f64, [Vector3<f64>; 2])> {
        self.0.value_and_gradient(x)
    }
    fn kernel() -> Kernel<Self, 2> {
        Kernel::in_lanes()
    }
}

impl<const HOW: usize> LaneConstraint<2> for Wrong<HOW> {
    const UNIT: bool = true;
    const NUMBERS: usize = 1;

    fn numbers(&self) -> [f64; MOST_NUMBERS] {
        self.0.numbers()
    }

    #[inline(always)]
    fn in_lanes<N: Lane>(
        machine: N::Machine,
        numbers: [N; MOST_NUMBERS],
        x: &[[N; 3]; 2],
    ) -> Several<N, 2> {
        let mut at = *x;
        if N::COUNT > 1 && HOW == 1 {
            // The sum of squares in another order.
            at.iter_mut().for_each(|p| p.reverse());
        }
        let [rest, ..] = numbers;
        let mut found = Distance::in_lanes::<N>(machine, numbers, &at);
        if N::COUNT > 1 && HOW == 1 {
            found.gradient.iter_mut().for_each(|g| g.reverse());
        }
        if N::COUNT > 1 && HOW == 2 {
            // A fused operation keeps digits that an intermediate rounding loses, here those of
            // the length.
            let third = N::splat(machine, 1.0 / 3.0);
            found.value = ((found.value + rest) * third - rest * third) / third;
        }
        if N::COUNT > 1 && HOW == 3 {
            let last = N::COUNT - 1;
            // Another constraint's rest length in one lane.
            let mut rests = [0.0; 8];
            rest.store(&mut rests);
            found.value =
                found.value + rest - N::each(machine, |l| rests[l - usize::from(l == last)]);
        }
        found
    }
}

fn wrong<const HOW: usize>() -> bool {
    let (mesh, body) = odd_body();
    let all: Vec<Wrong<HOW>> = edges(&mesh).into_iter().map(Wrong).collect();
    same(&all, &body).0
}

#[test]
fn p42_other_roundings_in_lanes_are_found() {
    assert!(wrong::<0>(), "the control itself is right");
    if SimdWidth::best() == SimdWidth::One {
        return;
    }
    assert!(!wrong::<1>(), "another order of a sum");
    assert!(!wrong::<2>(), "another rounding");
    assert!(!wrong::<3>(), "a neighbour's number");
}
