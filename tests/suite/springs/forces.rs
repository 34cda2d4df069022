//! Every force compared with its own energy, and changes that must not change its bits.

use nalgebra::{Point3, Vector3};
use pliant::constraints::SpringLaw;
use pliant::mesh::{Topology, shapes};
use pliant::springs::lattice::LatticeShape;
use pliant::springs::{Force, Hooke, Neighbours, SpringSystem, Springs, SystemError, patterns};
use pliant::testing::Draw;
use pliant::testing::internals::springs::cloth_patterns;
use pliant::testing::internals::springs::{
    AngularSpring, Buckling, CentreSprings, PairError, Strips, TrueVolume, VolumeError, anchors,
    angular_springs,
};

/// Difference of energies over a step: rounding error of 1e-16/1e-5 and step error of 1e-10.
const DIFFERENCE: f64 = 2e-8;

fn drawn(draw: &mut Draw, count: usize, scale: f64) -> Vec<Vector3<f64>> {
    (0..count)
        .map(|_| Vector3::from_fn(|_, _| scale * draw.between(-1.0, 1.0)))
        .collect()
}

fn forces_of(force: &dyn Force, x: &[Point3<f64>]) -> Vec<Vector3<f64>> {
    let mut f = vec![Vector3::zeros(); x.len()];
    force.add_force(x, &mut f);
    f
}

/// Greatest difference between the force and the slope of the energy, and between K p and the
/// slope of the force, relative to their own sizes.
fn slopes(force: &dyn Force, x: &[Point3<f64>], draw: &mut Draw) -> [f64; 2] {
    let h = 1e-5;
    let p = drawn(draw, x.len(), 1.0);
    let moved =
        |s: f64| -> Vec<Point3<f64>> { x.iter().zip(&p).map(|(x, p)| x + p * (s * h)).collect() };
    let (ahead, back) = (moved(1.0), moved(-1.0));
    let f = forces_of(force, x);
    let along: f64 = f.iter().zip(&p).map(|(f, p)| f.dot(p)).sum();
    let size: f64 = f.iter().zip(&p).map(|(f, p)| f.norm() * p.norm()).sum();
    assert!(
        size > 0.0 && along.abs() > 1e-6 * size,
        "a force that says nothing"
    );
    let slope = -(force.energy(&ahead) - force.energy(&back)) / (2.0 * h);
    let mut product = vec![Vector3::zeros(); x.len()];
    force.add_product(x, &p, false, &mut product);
    let (fa, fb) = (forces_of(force, &ahead), forces_of(force, &back));
    let wrong: f64 = (0..x.len())
        .map(|i| (product[i] + (fa[i] - fb[i]) / (2.0 * h)).norm())
        .sum();
    let all: f64 = product.iter().map(|p| p.norm()).sum();
    [(slope - along).abs() / size, wrong / all]
}

/// One force of each kind on the vertices of a crumpled sphere.
fn kinds() -> (Vec<Point3<f64>>, Vec<Box<dyn Force>>) {
    let mesh = shapes::icosphere(1.0, 1);
    let topology = Topology::new(&mesh);
    let count = mesh.vertices.len();
    let x = &mesh.vertices;
    let at_rest =
        |pairs: &[[u32; 2]]| patterns::at_rest(x, pairs.to_vec(), |l| 2.0 / l).collect::<Vec<_>>();
    let pattern = cloth_patterns::of_mesh(&mesh, &topology);
    let strips = at_rest(&pattern.bending).into_iter().map(|(ends, law)| {
        (
            ends,
            Buckling {
                rest: 1.2 * law.rest,
                bending: 0.3,
                compression: 50.0,
            },
        )
    });
    let angular = cloth_patterns::angular_at_rest(x, &pattern.angular, 3.0);
    let places = [
        (0, Point3::new(2.0, 0.5, 0.0), 0.0),
        (5, Point3::new(-0.3, 0.1, 0.7), 0.4),
    ];
    let places = places.map(|(p, at, rest)| {
        (
            p,
            at,
            Hooke {
                rest,
                stiffness: 5.0,
            },
        )
    });
    let forces: Vec<Box<dyn Force>> = vec![
        Box::new(Springs::new(count, at_rest(&pattern.structural)).unwrap()),
        Box::new(Strips::new(count, strips).unwrap()),
        Box::new(angular_springs(count, angular).unwrap()),
        Box::new(anchors(count, places).unwrap()),
        Box::new(TrueVolume::new(x, &mesh.triangles, 30.0, None, &[]).unwrap()),
    ];
    (mesh.vertices, forces)
}

#[test]
fn forces_are_slopes_of_energies_and_products_slopes_of_forces() {
    let mut draw = Draw::new(20_261_121);
    let (rest, forces) = kinds();
    for force in &forces {
        let x: Vec<_> = rest
            .iter()
            .zip(drawn(&mut draw, rest.len(), 0.1))
            .map(|(x, d)| x * 0.9 + d)
            .collect();
        let [first, second] = slopes(&**force, &x, &mut draw);
        assert!(first <= DIFFERENCE, "{}: force {first:e}", force.name());
        // The slope of a buckled strip is itself a difference, with kinks.
        let most = if force.name() == "buckling strips" {
            1e-4
        } else {
            DIFFERENCE
        };
        assert!(second <= most, "{}: product {second:e}", force.name());
        if force.name() != "anchors" {
            let f = forces_of(&**force, &x);
            let (sum, size) = f
                .iter()
                .fold((Vector3::zeros(), 0.0), |(s, n), f| (s + f, n + f.norm()));
            let torque: Vector3<f64> = f.iter().zip(&x).map(|(f, x)| x.coords.cross(f)).sum();
            assert!(
                sum.norm() <= 1e-13 * size && torque.norm() <= 1e-13 * size,
                "{}",
                force.name()
            );
        }
    }
}

/// A force of the wrong sign, and one with a product of half its slope.
struct Wrong(Springs, f64, f64);

impl Force for Wrong {
    fn name(&self) -> &'static str {
        "wrong"
    }
    fn elements(&self) -> usize {
        1
    }
    fn highest_point(&self) -> Option<u32> {
        None
    }
    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        self.0.energy(x)
    }
    fn add_force(&self, x: &[Point3<f64>], force: &mut [Vector3<f64>]) {
        let f = forces_of(&self.0, x);
        force
            .iter_mut()
            .zip(f)
            .for_each(|(to, f)| *to += f * self.1);
    }
    fn add_product(
        &self,
        x: &[Point3<f64>],
        p: &[Vector3<f64>],
        definite: bool,
        product: &mut [Vector3<f64>],
    ) {
        let scaled: Vec<_> = p.iter().map(|p| p * self.2).collect();
        self.0.add_product(x, &scaled, definite, product);
    }
    fn add_row_sums(&self, _: &[Point3<f64>], _: &mut [f64]) {}
}

#[test]
fn control_wrong_forces_and_products_are_found() {
    let mut draw = Draw::new(3);
    let x = vec![
        Point3::origin(),
        Point3::new(1.0, 0.2, 0.0),
        Point3::new(0.0, 1.0, 0.3),
    ];
    let springs = || {
        Springs::new(
            3,
            [
                (
                    [0, 1],
                    Hooke {
                        rest: 0.5,
                        stiffness: 3.0,
                    },
                ),
                (
                    [1, 2],
                    Hooke {
                        rest: 2.0,
                        stiffness: 1.0,
                    },
                ),
            ],
        )
    };
    let [force, product] = slopes(&Wrong(springs().unwrap(), 1.0, 1.0), &x, &mut draw);
    assert!(force <= DIFFERENCE && product <= DIFFERENCE);
    // The sign of errata M1: l taken as x_j - x_i with "minus the sum".
    let [force, _] = slopes(&Wrong(springs().unwrap(), -1.0, 1.0), &x, &mut draw);
    assert!(force > 1e-3);
    let [_, product] = slopes(&Wrong(springs().unwrap(), 1.0, 0.5), &x, &mut draw);
    assert!(product > 1e-3);
}

#[test]
fn b03_springs_of_rest_length_zero_have_a_force_everywhere() {
    let two = |rest: f64| {
        Springs::new(
            2,
            [(
                [0, 1],
                Hooke {
                    rest,
                    stiffness: 5.0,
                },
            )],
        )
        .unwrap()
    };
    let at = |x: f64| [Point3::origin(), Point3::new(x, 0.0, 0.0)];
    let zero = two(0.0);
    assert_eq!(forces_of(&zero, &at(0.0)), [Vector3::zeros(); 2]);
    assert_eq!(
        forces_of(&zero, &at(1e-3))[0],
        Vector3::new(0.005, 0.0, 0.0)
    );
    // A spring with a rest length has no preferred direction here.
    assert_eq!(forces_of(&two(1.0), &at(0.0)), [Vector3::zeros(); 2]);
    // The printed form, k (|x| - l) x/|x|.
    let printed = |x: f64| 5.0 * (x - 0.0) * x / x;
    assert!(printed(0.0).is_nan() && printed(1e-3) == 0.005);
}

#[test]
fn a_strip_buckles_at_the_load_of_its_arc() {
    let strip = Buckling {
        rest: 2.0,
        bending: 0.5,
        compression: 1e4,
    };
    // A slightly shortened strip is a spring. A buckled strip pushes with slightly more than 12
    // B/l^2.
    assert_eq!(strip.tension(2.0), 0.0);
    assert_eq!(strip.tension(2.5), 0.0);
    let load = 12.0 * 0.5 / 4.0;
    assert!(
        (strip.tension(1.9999) + 1.0).abs() <= 1e-9,
        "{}",
        strip.tension(1.9999)
    );
    // For small angles tension = -12 B/l^2 (1 + O(y^2)), y^2 = 6 (1 - |x|/l).
    let share = -strip.tension(1.999) / load;
    assert!(share > 1.0 && share <= 1.003, "{share}");
    // A half circle has known values: chord l sinc(pi/2), kappa = pi/l.
    let half = 2.0 * 2.0 / std::f64::consts::PI;
    let kappa = std::f64::consts::PI / 2.0;
    let expected = 0.5 * kappa * kappa / (0.0 - 2.0 / std::f64::consts::PI);
    assert!((strip.tension(half) / expected - 1.0).abs() <= 1e-9);
    let arc = 0.5 * 0.5 * 2.0 * kappa * kappa;
    // Before buckling the stiff spring stores slightly less energy than the arc.
    assert!((strip.energy(half) / arc - 1.0).abs() <= 1e-3);
}

#[test]
fn the_order_of_springs_and_the_threads_change_no_bit() {
    let shape = LatticeShape::with_longest_side([32, 32, 32], 1.0).unwrap();
    let x = shape.positions();
    let mut springs: Vec<_> =
        patterns::at_rest(&x, patterns::lattice(&shape, Neighbours::Six), |l| 1.0 / l).collect();
    let mut draw = Draw::new(8);
    let moved: Vec<_> = x
        .iter()
        .zip(drawn(&mut draw, x.len(), 0.01))
        .map(|(x, d)| x + d)
        .collect();
    let bits = |springs: &[([u32; 2], Hooke)], threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let springs = Springs::new(x.len(), springs.iter().copied()).unwrap();
            let f: Vec<u64> = forces_of(&springs, &moved)
                .iter()
                .flat_map(|f| [f.x, f.y, f.z])
                .map(f64::to_bits)
                .collect();
            (f, springs.energy(&moved).to_bits())
        })
    };
    let one = bits(&springs, 1);
    assert!(bits(&springs, 4) == one);
    springs.reverse();
    springs.iter_mut().for_each(|(ends, _)| ends.reverse());
    springs.swap(5, 4000);
    assert!(bits(&springs, 2) == one);
    springs[7].1.rest *= 1.0 + 1e-12;
    assert!(bits(&springs, 1) != one, "control: a spring that differs");
}

#[test]
fn b04_centre_springs_see_a_change_of_volume_where_there_is_none() {
    // Tables of the errata: +1 % radius of spheres of 264, 1104, 4512 triangles; here of subdivided icosahedra.
    let mut inward = Vec::new();
    for n in [1, 2, 3] {
        let mesh = shapes::icosphere(1.0, n);
        let springs = CentreSprings::new(&mesh.vertices, &mesh.triangles, 1.0, 0.5).unwrap();
        let blown: Vec<_> = mesh.vertices.iter().map(|p| p * 1.01).collect();
        let mean_area = mesh.area() / mesh.triangles.len() as f64;
        let volume = mesh.volume();
        let (seen, _) = springs.change(&blown);
        let gained = volume * (1.01_f64.powi(3) - 1.0);
        assert!(
            (seen * mean_area / gained - 1.0).abs() <= 0.12,
            "{n}: {}",
            seen * mean_area / gained
        );
        inward.push(
            forces_of(&springs, &blown)
                .iter()
                .map(|f| f.norm())
                .sum::<f64>()
                / mesh.vertices.len() as f64,
        );
        // Stretched to twice its length without a change of volume.
        let s = 0.5_f64.sqrt();
        let long: Vec<_> = mesh
            .vertices
            .iter()
            .map(|p| Point3::new(p.x * s, p.y * s, p.z * 2.0))
            .collect();
        let seen = springs.change(&long).0 * mean_area / volume;
        assert!(seen > 0.4, "{seen}");
        let exact = TrueVolume::new(&mesh.vertices, &mesh.triangles, 1.0, None, &[]).unwrap();
        assert!((exact.volume(&long) / volume - 1.0).abs() <= 1e-14);
    }
    // The force on a point grows with the number of triangles.
    assert!(
        inward[2] > 3.5 * inward[1] && inward[1] > 3.5 * inward[0],
        "{inward:?}"
    );
}

#[test]
fn the_true_volume_presses_the_same_on_every_mesh_and_takes_weights() {
    let mut sums = Vec::new();
    for n in [2, 3] {
        let mesh = shapes::icosphere(1.0, n);
        let volume = TrueVolume::new(&mesh.vertices, &mesh.triangles, 1e3, None, &[]).unwrap();
        let blown: Vec<_> = mesh.vertices.iter().map(|p| p * 1.01).collect();
        assert!((volume.pressure(&blown) + 1e3 * (1.01_f64.powi(3) - 1.0)).abs() <= 1e-10 * 1e3);
        let all: f64 = forces_of(&volume, &blown).iter().map(|f| f.norm()).sum();
        sums.push(all / (-volume.pressure(&blown) * mesh.area() * 1.01 * 1.01));
    }
    // The sum is pressure times area, for all triangulations.
    assert!(sums.iter().all(|s| (s - 1.0).abs() <= 0.02), "{sums:?}");
    let mesh = shapes::icosphere(1.0, 1);
    let weight: Vec<f64> = mesh
        .vertices
        .iter()
        .map(|p| if p.z > 0.0 { 1.0 } else { 0.25 })
        .collect();
    let half = TrueVolume::new(&mesh.vertices, &mesh.triangles, 1e3, Some(5.0), &weight).unwrap();
    let full = TrueVolume::new(&mesh.vertices, &mesh.triangles, 1e3, Some(5.0), &[]).unwrap();
    let (half, full) = (
        forces_of(&half, &mesh.vertices),
        forces_of(&full, &mesh.vertices),
    );
    for (i, w) in weight.iter().enumerate() {
        assert!((half[i] - full[i] * *w).norm() <= 1e-12 * full[i].norm());
    }
    let refused = |x: Result<TrueVolume, VolumeError>| x.map(|_| ()).unwrap_err();
    let (x, t) = (&mesh.vertices, &mesh.triangles);
    let inside_out: Vec<_> = t.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    assert!(
        matches!(refused(TrueVolume::new(x, &inside_out, 1.0, None, &[])), VolumeError::NoVolume(v) if v < 0.0)
    );
    assert!(matches!(
        refused(TrueVolume::new(x, t, -1.0, None, &[])),
        VolumeError::Parameter { .. }
    ));
    assert!(matches!(
        refused(TrueVolume::new(x, t, 1.0, None, &[1.0])),
        VolumeError::Weights {
            weights: 1,
            points: 42
        }
    ));
    assert!(matches!(
        refused(TrueVolume::new(x, &[[0, 1, 99]], 1.0, None, &[])),
        VolumeError::OutOfRange { point: 99, .. }
    ));
}

#[test]
fn what_is_no_system_is_refused() {
    let law = |rest: f64, stiffness: f64| Hooke { rest, stiffness };
    let of = |ends: [u32; 2], law: Hooke| Springs::new(3, [(ends, law)]).map(|_| ()).unwrap_err();
    assert_eq!(
        of([0, 3], law(1.0, 1.0)),
        PairError::OutOfRange {
            spring: 0,
            point: 3,
            count: 3
        }
    );
    assert_eq!(
        of([1, 1], law(1.0, 1.0)),
        PairError::Loop {
            spring: 0,
            point: 1
        }
    );
    for wrong in [law(-1.0, 1.0), law(f64::NAN, 1.0), law(1.0, f64::INFINITY)] {
        assert_eq!(of([0, 1], wrong), PairError::Parameter { spring: 0 });
    }
    let twice = AngularSpring {
        points: [0, 1, 1],
        law: law(1.0, 1.0),
    };
    assert!(angular_springs(3, [twice]).is_err());
    let system =
        |x: Vec<Point3<f64>>, m: Vec<f64>| SpringSystem::new(x, m).map(|_| ()).unwrap_err();
    let o = Point3::origin();
    assert_eq!(system(vec![], vec![]), SystemError::Empty);
    assert_eq!(
        system(vec![o], vec![]),
        SystemError::Masses {
            masses: 0,
            points: 1
        }
    );
    assert_eq!(
        system(vec![o], vec![0.0]),
        SystemError::Mass {
            point: 0,
            mass: 0.0
        }
    );
    assert_eq!(
        system(vec![Point3::new(f64::NAN, 0.0, 0.0)], vec![1.0]),
        SystemError::NotFinite { point: 0 }
    );
    let mut small = SpringSystem::new(vec![o], vec![1.0]).unwrap();
    let springs = Springs::new(2, [([0, 1], law(1.0, 1.0))]).unwrap();
    assert!(matches!(
        small.add(springs),
        Err(SystemError::OutOfRange {
            point: 1,
            count: 1,
            ..
        })
    ));
}
