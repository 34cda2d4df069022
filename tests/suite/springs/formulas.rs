//! Masses, stiffness, patterns and layers compared with the numbers of the sources and their
//! errata.

use nalgebra::{Point3, Vector3};
use pliant::mesh::{Topology, TriangleMesh, shapes};
use pliant::springs::damping::{DampedBody, estimate};
use pliant::springs::lattice::{LatticeError, LatticeShape};
use pliant::springs::{Neighbours, patterns};
use pliant::testing::internals::springs::cloth_patterns;
use pliant::testing::internals::springs::mass::{self, MassError};
use pliant::testing::internals::springs::stiffness::{
    Negative, along_edges, area_over_length, membrane, of_side,
};
use pliant::testing::internals::springs::{LayerMaterial, layers};

fn triangle(points: [[f64; 2]; 3]) -> TriangleMesh {
    let vertices = points.map(|[x, y]| Point3::new(x, y, 0.0)).to_vec();
    TriangleMesh {
        vertices,
        triangles: vec![[0, 1, 2]],
    }
}

/// Energy of a uniform strain `e` (xx, yy, xy) of a triangle of springs, relative to plane stress,
/// E2 = 1.
fn share(mesh: &TriangleMesh, nu: f64, [xx, yy, xy]: [f64; 3]) -> f64 {
    let topology = Topology::new(mesh);
    let found = membrane(mesh, &topology, 1.0, nu, Negative::Keep);
    let mut energy = 0.0;
    for (&[a, b], k) in topology.edges.iter().zip(&found.stiffness) {
        let d = mesh.vertices[b as usize] - mesh.vertices[a as usize];
        let stretch = (d.x * d.x * xx + d.y * d.y * yy + 2.0 * d.x * d.y * xy) / d.norm();
        energy += 0.5 * k * stretch * stretch;
    }
    let plane = (xx * xx + yy * yy + 2.0 * nu * xx * yy + 2.0 * (1.0 - nu) * xy * xy)
        / (2.0 * (1.0 - nu * nu));
    energy / mesh.area() / plane
}

#[test]
fn b02_stiffness_is_that_of_plane_stress_where_springs_can_be() {
    let equilateral = triangle([[0.0, 0.0], [1.0, 0.0], [0.5, 0.75_f64.sqrt()]]);
    let right = triangle([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    let obtuse = triangle([[0.0, 0.0], [1.0, 0.0], [-0.6, 0.4]]);
    let area = equilateral.area();
    assert!((of_side([1.0; 3], area, 1.0, 1.0 / 3.0) - 3_f64.sqrt() / 4.0).abs() <= 1e-15);
    let strains = [[1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    // Rows of the errata's output, to their last digit.
    let rows = [
        (&equilateral, 0.0, [1.5, 1.125, 0.75]),
        (&equilateral, 1.0 / 3.0, [1.0, 1.0, 1.0]),
        (&equilateral, 0.45, [0.879, 0.956, 1.159]),
        (&right, 1.0 / 3.0, [1.0, 1.167, 0.5]),
        (&right, 0.45, [0.879, 1.138, 0.5]),
        (&obtuse, 0.0, [1.5, 2.365, 0.537]),
        (&obtuse, 0.45, [0.879, 1.506, 1.425]),
    ];
    for (mesh, nu, expected) in rows {
        for (strain, expected) in strains.into_iter().zip(expected) {
            let found = share(mesh, nu, strain);
            assert!(
                (found - expected).abs() <= 5e-4,
                "{nu}: {found} for {expected}"
            );
        }
        let dilation = share(mesh, nu, strains[0]);
        assert!(
            (dilation - (3.0 - nu) / (2.0 * (1.0 + nu))).abs() <= 1e-13,
            "{dilation}"
        );
    }
    // Control: the printed form is twice this.
    let printed =
        |c: f64, nu: f64| 2.0 * area / (c * c) / (1.0 + nu) + nu / (1.0 - nu * nu) / (4.0 * area);
    assert!(
        (printed(1.0, 1.0 / 3.0) / of_side([1.0; 3], area, 1.0, 1.0 / 3.0) - 2.0).abs() <= 1e-14
    );
}

#[test]
fn b02_negative_stiffness_is_told_and_clamped_where_that_is_wanted() {
    let obtuse = triangle([[0.0, 0.0], [1.0, 0.0], [-0.6, 0.4]]);
    let topology = Topology::new(&obtuse);
    let kept = membrane(&obtuse, &topology, 1.0, 0.45, Negative::Keep);
    // Edges 01, 02, 12: the errata's 0.928, 1.394 and -0.372 opposite the obtuse angle.
    for (found, expected) in kept.stiffness.iter().zip([0.928, 1.394, -0.372]) {
        assert!((found - expected).abs() <= 5e-4, "{:?}", kept.stiffness);
    }
    let clamped = membrane(&obtuse, &topology, 1.0, 0.45, Negative::Clamp);
    assert_eq!(
        (clamped.stiffness[2], &clamped.negative),
        (0.0, &kept.negative)
    );
    assert_eq!(kept.negative.len(), 1);
    assert!(along_edges(&obtuse, &topology, &kept.stiffness).is_ok());
    assert!(along_edges(&obtuse, &topology, &[f64::NAN; 3]).is_err());
    let flat = triangle([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]);
    assert_eq!(
        membrane(&flat, &Topology::new(&flat), 1.0, 0.3, Negative::Keep).stiffness,
        [0.0; 3]
    );
}

#[test]
fn m17_simple_stiffness_and_sheet_masses_have_the_thickness() {
    let square = shapes::box_surface([1.0, 1.0, 1.0], 1.0);
    let masses = mass::of_sheet(&square, 1000.0, 0.002).unwrap();
    assert!((masses.iter().sum::<f64>() - 12.0).abs() <= 1e-12);
    let right = triangle([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]]);
    // E2 A/L^2 with A = 2: legs 1/2, hypotenuse 1/4.
    let found = area_over_length(&right, &Topology::new(&right), 1.0);
    assert!(
        (found[0] - 0.5).abs() <= 1e-15 && (found[2] - 0.25).abs() <= 1e-15,
        "{found:?}"
    );
}

#[test]
fn b01_masses_add_up_and_signed_ones_that_are_negative_are_refused() {
    let sum = |m: &[f64]| m.iter().sum::<f64>();
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-12 * b;
    let sphere = shapes::icosphere(1.0, 2);
    assert!(near(sum(&mass::by_area(&sphere, 3.0).unwrap()), 3.0));
    assert!(near(
        sum(&mass::by_fan(&sphere, Point3::origin(), 3.0).unwrap()),
        3.0
    ));
    let x = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 1.0, 1.0],
    ]
    .map(Point3::from);
    let tetrahedra = [[0, 1, 2, 3], [4, 2, 1, 3]];
    let found = mass::by_tetrahedra(&x, &tetrahedra, 3.0).unwrap();
    assert!(near(sum(&found), 3.0), "with 3 V it would be 4/3 of that");
    assert!(
        near(found[0], 3.0 * 0.25 / 3.0) && near(found[4], 3.0 * 0.25 * 2.0 / 3.0),
        "{found:?}"
    );
    // The errata's bowl: the upper half reflected downwards.
    let mut bowl = sphere;
    bowl.vertices
        .iter_mut()
        .filter(|p| p.z > 1e-9)
        .for_each(|p| p.z *= -0.8);
    let centre = bowl.centroid().unwrap();
    let refused = mass::by_fan(&bowl, centre, 1.0).unwrap_err();
    assert!(
        matches!(refused, MassError::NotPositive { points, least } if points > 20 && least < -0.01),
        "{refused:?}"
    );
    assert!(mass::by_area(&bowl, 1.0).is_ok());
    let flat = triangle([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]);
    assert!(matches!(
        mass::by_area(&flat, 1.0),
        Err(MassError::Nothing {
            measure: "area",
            ..
        })
    ));
    assert!(matches!(
        mass::by_tetrahedra(&x, &[[0, 1, 2, 9]], 1.0),
        Err(MassError::OutOfRange { point: 9, .. })
    ));
}

#[test]
fn springs_of_lattices_are_counted_exactly() {
    for (n, six, all) in [
        (5, 300, 1036),
        (10, 2700, 10_476),
        (70, 1_014_300, 4_327_956),
        (100, 2_970_000, 12_731_796),
    ] {
        assert_eq!(
            (
                Neighbours::Six.springs([n; 3]),
                Neighbours::TwentySix.springs([n; 3])
            ),
            (six, all)
        );
    }
    for points in [[2, 2, 2], [3, 4, 5], [2, 7, 3], [1, 4, 2], [1, 1, 1]] {
        let shape = LatticeShape::with_longest_side(points, 1.0).unwrap();
        let x = shape.positions();
        assert_eq!(x.len(), shape.count());
        for neighbours in [Neighbours::Six, Neighbours::TwentySix] {
            let mut edges: Vec<_> = patterns::lattice(&shape, neighbours).collect();
            assert_eq!(edges.len(), neighbours.springs(points));
            edges.sort_unstable();
            edges.dedup();
            assert_eq!(edges.len(), neighbours.springs(points), "a spring twice");
            let reach = shape.spacing[0]
                * if neighbours == Neighbours::Six {
                    1.0
                } else {
                    3_f64.sqrt()
                };
            assert!(edges.iter().all(|[a, b]| (x[*a as usize] - x[*b as usize]).norm() <= reach * (1.0 + 1e-12)));
        }
    }
    let shape = LatticeShape::with_longest_side([3, 4, 5], 2.0).unwrap();
    let far = nalgebra::center(&shape.positions()[0], &shape.positions()[59]);
    assert_eq!(
        (shape.spacing, far),
        ([0.5; 3], Point3::new(0.5, 0.75, 1.0))
    );
    let cube = LatticeShape::with_longest_side([5; 3], 1.0).unwrap();
    assert_eq!((cube.surface().len(), cube.count()), (98, 125));
    let refused =
        |points: [usize; 3], side: f64| LatticeShape::with_longest_side(points, side).unwrap_err();
    assert!(matches!(
        refused([5, 0, 5], 1.0),
        LatticeError::Points {
            points: [5, 0, 5],
            ..
        }
    ));
    assert!(matches!(
        refused([1 << 11, 1 << 11, 1 << 10], 1.0),
        LatticeError::Points { .. }
    ));
    assert!(matches!(
        refused([usize::MAX; 3], 1.0),
        LatticeError::Points { .. }
    ));
    assert!(matches!(
        refused([5; 3], f64::NAN),
        LatticeError::Value {
            name: "the longest side",
            ..
        }
    ));
}

#[test]
fn grids_and_meshes_have_their_patterns() {
    let grid = cloth_patterns::grid(4, 3);
    let counts = [
        grid.structural.len(),
        grid.shear.len(),
        grid.bending.len(),
        grid.angular.len(),
    ];
    assert_eq!(counts, [3 * 3 + 4 * 2, 2 * 3 * 2, 2 * 3 + 4, 2 * 3 + 4]);
    assert!(
        grid.shear.contains(&[0, 5])
            && grid.shear.contains(&[1, 4])
            && grid.angular.contains(&[5, 1, 9])
    );
    assert_eq!(
        cloth_patterns::grid(u32::MAX, 2),
        cloth_patterns::GridPattern::default()
    );
    let sphere = shapes::icosphere(1.0, 1);
    let topology = Topology::new(&sphere);
    let pattern = cloth_patterns::of_mesh(&sphere, &topology);
    assert_eq!(
        (pattern.structural.len(), pattern.bending.len()),
        (120, 120)
    );
    // 12 vertices of 5 neighbours, 30 of 6; two opposite ones of 5 are not exactly opposite.
    assert_eq!(pattern.angular.len(), 12 * 2 + 30 * 3);
    let across = |[_, a, b]: &[u32; 3]| {
        sphere.vertices[*a as usize]
            .coords
            .angle(&sphere.vertices[*b as usize].coords)
    };
    assert!(
        pattern.angular.iter().all(|t| across(t) > 0.8),
        "opposite neighbours are far apart"
    );
    let sheet = sheet(2);
    let inner = cloth_patterns::of_mesh(&sheet, &Topology::new(&sheet)).angular;
    assert!(
        inner.iter().all(|t| t[0] == 4) && inner.len() == 3,
        "rims have no opposite neighbours: {inner:?}"
    );
}

/// The unit square around the origin, n by n squares with equal diagonals.
fn sheet(n: u32) -> TriangleMesh {
    let at = |i: u32| f64::from(i) / f64::from(n) - 0.5;
    let vertices = (0..=n)
        .flat_map(|i| (0..=n).map(move |j| Point3::new(at(i), at(j), 0.0)))
        .collect();
    let square = |a: u32| [[a, a + n + 1, a + n + 2], [a, a + n + 2, a + 1]];
    let triangles = (0..n)
        .flat_map(|i| (0..n).flat_map(move |j| square(i * (n + 1) + j)))
        .collect();
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// The triangles with a vertex within 0.375 of the centre, with their vertices only.
fn region(sheet: &TriangleMesh) -> TriangleMesh {
    let near = |v: &u32| sheet.vertices[*v as usize].coords.norm_squared() <= 0.375 * 0.375;
    let kept: Vec<[u32; 3]> = sheet
        .triangles
        .iter()
        .copied()
        .filter(|t| t.iter().any(near))
        .collect();
    let mut used: Vec<u32> = kept.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let place = |v: u32| used.binary_search(&v).unwrap() as u32;
    let vertices = used.iter().map(|v| sheet.vertices[*v as usize]).collect();
    TriangleMesh {
        vertices,
        triangles: kept.into_iter().map(|t| t.map(place)).collect(),
    }
}

#[test]
fn b11_a_patch_in_two_layers_has_the_published_counts() {
    let material = LayerMaterial {
        e2: 100.0,
        nu: 0.3,
        diagonal: 1.0,
        upright: 0.0,
        negative: Negative::Clamp,
    };
    let mut counts = Vec::new();
    for n in [64, 128] {
        let patch = region(&sheet(n));
        let found = layers(
            &patch,
            &Topology::new(&patch),
            Vector3::new(0.0, 0.0, -0.02),
            material,
        );
        counts.push((
            found.position.len(),
            2 * patch.triangles.len(),
            found.springs.len(),
        ));
        if n == 64 {
            assert_eq!((found.rim.len(), found.count), (2 * 168, 1961));
            let half = membrane(&patch, &Topology::new(&patch), 50.0, 0.3, Negative::Clamp);
            assert_eq!(found.edges, half, "each layer has half of the thickness");
            let more = layers(
                &patch,
                &Topology::new(&patch),
                Vector3::z(),
                LayerMaterial {
                    upright: 5.0,
                    ..material
                },
            );
            assert_eq!(more.springs.len(), found.springs.len() + 1961 - 168);
        }
    }
    assert_eq!(counts, [(3922, 7504, 22_176), (15_090, 29_512, 87_872)]);
}

#[test]
fn m13_the_damping_estimate_is_that_of_the_table_and_of_any_size() {
    let of = |n: u32, mass: f64, side: f64| {
        let body = DampedBody {
            mass,
            tension: 1.0,
            side,
            spacing: side / f64::from(n - 1),
        };
        estimate(Neighbours::Six, body)
    };
    // Table 7.6, m = 8 to 0.125.
    let rows = [
        (5, [13.86, 9.8, 6.93, 4.9, 3.46, 2.45, 1.73]),
        (10, [12.51, 8.84, 6.25, 4.42, 3.13, 2.21, 1.56]),
        (20, [11.89, 8.41, 5.95, 4.21, 2.97, 2.1, 1.49]),
    ];
    for (n, row) in rows {
        for (k, expected) in row.into_iter().enumerate() {
            let found = of(n, 8.0 / f64::from(1 << k), 1.0);
            assert!(
                (found - expected).abs() <= 0.01,
                "{n} {k}: {found} for {expected}"
            );
        }
    }
    // A cube of side 0.2: 10.954, where (7.2) as printed gives 4.195.
    assert!(
        (of(5, 1.0, 0.2) - 10.954).abs() <= 5e-4,
        "{}",
        of(5, 1.0, 0.2)
    );
    // 26 neighbours: means of c^2/(8 m) in table 7.5.
    for (n, mean) in [(5, 11.09), (10, 10.54), (20, 9.78)] {
        let body = DampedBody {
            mass: 1.0,
            tension: 1.0,
            side: 1.0,
            spacing: 1.0 / f64::from(n - 1),
        };
        let found = estimate(Neighbours::TwentySix, body);
        assert!(
            (found / (8.0_f64 * mean).sqrt() - 1.0).abs() <= 0.02,
            "{n}: {found}"
        );
    }
}
