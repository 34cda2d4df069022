//! Templates: their curves, grids and surfaces.

use pliant::fibres::Template;
use pliant::mesh::Topology;
use pliant::springs::Neighbours;
use pliant::springs::patterns::lattice;
use pliant::testing::internals::fibres::{Grid, Sampling};

use crate::tolerances::{T1, worst};

#[test]
fn corner_curves_are_met_and_stay_in_the_cube() {
    for (name, template) in Template::NAMED {
        assert_eq!(Template::by_name(name), Some(template));
        for (r, s) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let [a, b, c, d] = template.corner_curve(r, s);
            assert!(
                (template.at(r, s, 0.0) - a).norm() <= T1
                    && (template.at(r, s, 1.0) - d).norm() <= T1,
                "{name}"
            );
            // De Casteljau gives the midpoint.
            let middle = |p, q| nalgebra::center(&p, &q);
            let half = middle(
                middle(middle(a, b), middle(b, c)),
                middle(middle(b, c), middle(c, d)),
            );
            assert!((template.at(r, s, 0.5) - half).norm() <= T1, "{name}");
        }
        let grid = Sampling::new(64, 33).expect("a grid");
        let out = grid
            .positions(template)
            .into_iter()
            .flat_map(|p| p.coords.iter().map(|x| (x - 0.5).abs()).collect::<Vec<_>>());
        assert!(worst(out) <= 0.5 + T1, "{name} leaves the cube");
    }
    assert_eq!(Template::by_name("bipennate"), None);
    // Areas: on opposite faces, on opposite sides, on one face, narrower than the belly.
    let at = |t: Template, r: f64, s: f64, along: f64| t.at(r, s, along);
    assert!(
        at(Template::Pennate, 0.3, 0.4, 0.0).x.abs() <= T1
            && (at(Template::Pennate, 0.3, 0.4, 1.0).x - 1.0).abs() <= T1
    );
    assert!(
        at(Template::Curved, 0.3, 0.4, 0.0).z.abs() <= T1
            && at(Template::Curved, 0.3, 0.4, 1.0).z.abs() <= T1
    );
    let width = |along: f64| {
        at(Template::Rectus, 1.0, 0.5, along).x - at(Template::Rectus, 0.0, 0.5, along).x
    };
    assert!(
        width(0.5) > 2.0 * width(0.0),
        "{} {}",
        width(0.5),
        width(0.0)
    );
}

#[test]
fn no_template_is_folded_and_a_swap_would_be() {
    for (name, template) in Template::NAMED {
        let sampling = Sampling::new(100, 15).expect("a grid");
        let grid = Grid {
            sampling,
            points: sampling.positions(template),
        };
        let least = grid.jacobian().into_iter().fold(f64::INFINITY, f64::min);
        println!("{name}: least scaled Jacobian {least:.3}");
        assert!(least > 0.0, "{name}: {least}");
        if template == Template::Parallel {
            assert!(worst(grid.jacobian().into_iter().map(|j| (j - 1.0).abs())) <= T1);
        }
        let mut folded = grid.clone();
        folded
            .points
            .swap(sampling.number([4, 4, 7]), sampling.number([6, 4, 7]));
        assert!(
            folded.jacobian().iter().any(|j| *j < 0.0),
            "control: {name}"
        );
        let mut flat = grid;
        flat.points[1] = flat.points[0];
        assert!(flat.jacobian().contains(&0.0), "control: {name}");
    }
}

#[test]
fn grids_are_nearly_square() {
    let sides = |count: usize| Sampling::new(count, 15).expect("a grid").points;
    for (count, expected) in [
        (100, [10, 10]),
        (50, [10, 5]),
        (24, [6, 4]),
        (4, [2, 2]),
        (6, [3, 2]),
        (200, [20, 10]),
    ] {
        assert_eq!(sides(count), [expected[0], expected[1], 15], "{count}");
    }
    // A prime has no grid: 7 uses 2 by 4, 101 uses 13 by 8.
    assert_eq!((sides(7), sides(101)), ([4, 2, 15], [13, 8, 15]));
    for count in 1..=130 {
        let grid = Sampling::new(count, 5).expect("a grid");
        let points = grid.positions(Template::Parallel);
        let fibres = Grid {
            sampling: grid,
            points,
        }
        .fibres();
        assert_eq!(fibres.len(), count);
        let mut starts: Vec<_> = fibres
            .iter()
            .map(|f| f[0].coords.map(f64::to_bits))
            .collect();
        starts.sort_by_key(|s| [s.x, s.y]);
        starts.dedup();
        assert_eq!(starts.len(), count, "a fibre twice of {count}");
        assert!(
            fibres
                .iter()
                .all(|f| f.len() == 5 && f[0].z.abs() <= T1 && (f[4].z - 1.0).abs() <= T1)
        );
    }
    assert!(Sampling::new(0, 15).is_none() && Sampling::new(100, 1).is_none());
}

#[test]
fn the_surface_is_closed_and_areas_are_its_ends() {
    for (name, template) in Template::NAMED {
        let sampling = Sampling::new(50, 7).expect("a grid");
        let (mesh, points) = sampling.surface(template);
        let topology = Topology::new(&mesh);
        assert!(
            topology.is_closed() && topology.is_oriented() && topology.euler_characteristic() == 2,
            "{name}"
        );
        assert!(mesh.volume() > 0.0, "{name} is inside out");
        let flags = sampling.on_surface();
        assert_eq!(points.len(), flags.iter().filter(|f| **f).count());
        assert_eq!(points.len(), 10 * 5 * 7 - 8 * 3 * 5);
        let at = |list: Vec<u32>, t: f64| {
            assert_eq!(list.len(), 50);
            let all: Vec<_> = sampling.parameters().collect();
            assert!(
                list.iter()
                    .all(|&p| all[p as usize][2] == t && flags[p as usize])
            );
        };
        at(sampling.origin(), 0.0);
        at(sampling.insertion(), 1.0);
    }
    let cube = Sampling::new(25, 5).expect("a grid");
    for (neighbours, count) in [(Neighbours::Six, 300), (Neighbours::TwentySix, 1036)] {
        assert_eq!(lattice(&cube.shape(), neighbours).count(), count);
    }
}
