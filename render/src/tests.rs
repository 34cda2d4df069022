use super::*;
use nalgebra::Vector3;
use proptest::prelude::*;

fn square_canvas(side: u32) -> Canvas {
    Canvas {
        width: side,
        height: side,
        insets: [0.0; 4],
    }
}

fn front_camera(side: u32) -> Camera {
    let corners = [Point3::new(-1.0, -1.0, -1.0), Point3::new(1.0, 1.0, 1.0)];
    Camera::fit(
        corners,
        &View::orthographic(Vector3::z(), Vector3::y()),
        square_canvas(side),
    )
}

/// A sphere of radius 1 as a subdivided octahedron.
fn sphere(cuts: usize) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let mut positions: Vec<Point3<f64>> = [
        [1, 0, 0],
        [-1, 0, 0],
        [0, 1, 0],
        [0, -1, 0],
        [0, 0, 1],
        [0, 0, -1],
    ]
    .map(|[x, y, z]| Point3::new(f64::from(x), f64::from(y), f64::from(z)))
    .to_vec();
    let mut triangles = vec![
        [0, 2, 4],
        [2, 1, 4],
        [1, 3, 4],
        [3, 0, 4],
        [2, 0, 5],
        [1, 2, 5],
        [3, 1, 5],
        [0, 3, 5],
    ];
    for _ in 0..cuts {
        let mut middles = std::collections::BTreeMap::new();
        let mut finer = Vec::new();
        for [a, b, c] in triangles {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(i, j): (u32, u32)| {
                *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                    let middle = positions[i as usize].coords + positions[j as usize].coords;
                    positions.push(Point3::from(middle.normalize()));
                    (positions.len() - 1) as u32
                })
            });
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    (positions, triangles)
}

fn dark(frame: &Frame, x: usize, y: usize) -> bool {
    frame
        .pixel(x, y)
        .is_some_and(|p| p.iter().map(|c| u32::from(*c)).sum::<u32>() < 700)
}

#[test]
fn a_spheres_picture_is_round() {
    let (positions, triangles) = sphere(5);
    let surface = Surface::plain(&positions, &triangles, colour::MUSCLE);
    let drawing = Drawing {
        lighting: Some(Lighting {
            ambient: 0.5,
            lights: vec![],
        }),
        ..Drawing::of([surface])
    };
    let side = 200usize;
    let frame = render(&drawing, &front_camera(side as u32));
    let mut area = 0;
    for y in 0..side {
        let row: Vec<usize> = (0..side).filter(|x| dark(&frame, *x, y)).collect();
        let column: Vec<usize> = (0..side).filter(|x| dark(&frame, y, *x)).collect();
        for line in [&row, &column] {
            if let (Some(first), Some(last)) = (line.first(), line.last()) {
                assert!(
                    (first + last).abs_diff(side - 1) <= 1,
                    "line {y}: {first} to {last}"
                );
            }
        }
        area += row.len();
    }
    let expected = std::f64::consts::PI * 100.0 * 100.0;
    assert!(
        (area as f64 / expected - 1.0).abs() < 0.01,
        "{area} of {expected}"
    );
}

#[test]
fn a_sphere_is_lit_by_lambert() {
    let (positions, triangles) = sphere(5);
    let lights = vec![(Light::Distant(Vector3::z()), 1.0)];
    let surface = Surface::plain(&positions, &triangles, [1.0; 3]);
    let drawing = Drawing {
        lighting: Some(Lighting {
            ambient: 0.0,
            lights,
        }),
        ..Drawing::of([surface])
    };
    let frame = render(&drawing, &front_camera(200));
    for x in [100, 120, 150, 180, 190] {
        let [value, ..] = frame.pixel(x, 100).expect("inside");
        let off = (x as f64 - 99.5) / 100.0;
        let cosine = (1.0 - off * off).sqrt();
        assert!(
            (f64::from(value) / 255.0 - cosine).abs() < 0.01,
            "{x}: {value} for {cosine}"
        );
    }
}

/// Erratum G12 through the whole renderer: the brightness at a vertex does not depend on the order of the corners.
#[test]
fn g12_brightness_stays_with_its_vertex() {
    let positions = [
        Point3::new(0.0, 10.0, 0.0),
        Point3::origin(),
        Point3::new(10.0, 5.0, 0.0),
    ];
    let view = View::orthographic(Vector3::z(), Vector3::y());
    let camera = Camera::fit(positions, &view, square_canvas(400));
    let lighting = Lighting {
        ambient: 0.0,
        lights: vec![(Light::At(Point3::new(0.0, 0.0, 5.0)), 1.0)],
    };
    for triangle in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1]] {
        let lit: Vec<Point3<f64>> = positions.to_vec();
        let triangles = [triangle];
        // Both sides are lit, so an order that shows the back needs its light behind.
        let back = triangle == [0, 2, 1];
        let place = Point3::new(0.0, 0.0, if back { -5.0 } else { 5.0 });
        let lighting = Lighting {
            lights: vec![(Light::At(place), 1.0)],
            ..lighting.clone()
        };
        let surface = Surface::plain(&lit, &triangles, [1.0; 3]);
        let drawing = Drawing {
            background: [0.0; 3],
            lighting: Some(lighting),
            ..Drawing::of([surface])
        };
        let frame = render(&drawing, &camera);
        if back {
            assert!(
                frame.pixels().iter().all(|p| *p == [0; 3]),
                "lit from behind"
            );
            continue;
        }
        for (inside, expected) in [([0.3, 9.5], 0.447), ([0.3, 0.5], 1.0), ([9.6, 5.0], 0.408)] {
            let (pixel, _) = camera
                .pixel(&Point3::new(inside[0], inside[1], 0.0))
                .expect("seen");
            let [value, ..] = frame
                .pixel(pixel[0] as usize, pixel[1] as usize)
                .expect("inside");
            assert!(
                (f64::from(value) / 255.0 - expected).abs() < 0.04,
                "{triangle:?}: {value}, {expected}"
            );
        }
    }
}

/// Errata G9 and G13: objects beyond all sides of the picture are clipped, with the same colours as
/// in a larger picture.
#[test]
fn g9_a_cut_off_triangle_keeps_its_colours() {
    let positions = [
        Point3::new(-3.0, -3.0, 0.5),
        Point3::new(4.0, -2.0, 0.0),
        Point3::new(-1.0, 5.0, -0.5),
    ];
    let values = [0.0, 0.5, 1.0];
    let surface = Surface::field(
        &positions,
        &[[0, 1, 2]],
        &values,
        (0.0, 1.0),
        ColourMap::Viridis,
    );
    let drawing = Drawing {
        lighting: Some(Lighting {
            ambient: 1.0,
            lights: vec![],
        }),
        ..Drawing::of([surface])
    };
    let near = render(&drawing, &front_camera(100));
    let view = View::orthographic(Vector3::z(), Vector3::y());
    // The same scale on a picture five times as wide and high.
    let wide = Camera::fit(
        [Point3::new(-5.0, -5.0, 0.0), Point3::new(5.0, 5.0, 0.0)],
        &view,
        square_canvas(500),
    );
    let far = render(&drawing, &wide);
    for y in 0..100 {
        for x in 0..100 {
            let (a, b) = (
                near.pixel(x, y).expect("inside"),
                far.pixel(x + 200, y + 200).expect("inside"),
            );
            assert!(
                a.iter().zip(&b).all(|(a, b)| a.abs_diff(*b) <= 2),
                "({x}, {y}): {a:?} {b:?}"
            );
        }
    }
}

#[test]
fn depth_wins_over_order() {
    let near = [
        Point3::new(-1.0, -1.0, 0.5),
        Point3::new(1.0, -1.0, 0.5),
        Point3::new(0.0, 1.0, 0.5),
    ];
    let far = near.map(|p| Point3::new(p.x, -p.y, -0.5));
    let red = Surface::plain(&near, &[[0, 1, 2]], [1.0, 0.0, 0.0]);
    let blue = Surface::plain(&far, &[[0, 2, 1]], [0.0, 0.0, 1.0]);
    let one = render(&Drawing::of([red, blue]), &front_camera(64));
    assert_eq!(one, render(&Drawing::of([blue, red]), &front_camera(64)));
    let [r, _, b] = one.pixel(32, 32).expect("inside");
    assert!(r > b);
}

#[test]
fn bones_are_seen_through_and_in_front() {
    let (positions, triangles) = sphere(3);
    let small: Vec<Point3<f64>> = positions.iter().map(|p| p * 0.5).collect();
    let muscle = Surface::plain(&small, &triangles, [1.0, 0.0, 0.0]);
    let bone = Surface::plain(&positions, &triangles, [0.0, 0.0, 1.0]).with_opacity(0.4);
    let seen = render(&Drawing::of([bone, muscle]), &front_camera(64));
    let [r, _, b] = seen.pixel(32, 32).expect("inside");
    assert!(r > 100 && b > 60 && r < 200, "{r} {b}");
    // An inside-out bone looks the same.
    let turned: Vec<[u32; 3]> = triangles.iter().map(|&[a, b, c]| [c, b, a]).collect();
    let bone = Surface {
        triangles: &turned,
        ..bone
    };
    let frame = render(&Drawing::of([muscle, bone]), &front_camera(64));
    let close = |(a, b): (&[u8; 3], &[u8; 3])| a.iter().zip(b).all(|(a, b)| a.abs_diff(*b) <= 1);
    assert!(frame.pixels().iter().zip(seen.pixels()).all(close));
}

#[test]
fn lines_lie_on_their_surface_and_hide_behind_it() {
    let (positions, triangles) = sphere(4);
    let arc = |z: f64| {
        (0..=40)
            .map(|i| f64::from(i) / 20.0 - 1.0)
            .map(|t| Point3::new(0.6 * t, 0.0, z * (1.0 - 0.36 * t * t).sqrt()))
            .collect()
    };
    let surface = Surface::plain(&positions, &triangles, [0.0, 0.0, 1.0]);
    for (z, seen) in [(1.0, true), (-1.0, false)] {
        let line: Vec<Vec<Point3<f64>>> = vec![arc(z)];
        let drawing = Drawing::of([surface]).with_lines(Lines::new(&line, [1.0, 0.0, 0.0]));
        let view = View::orthographic(Vector3::z(), Vector3::y());
        let camera = Camera::fit(positions.iter().copied(), &view, square_canvas(128));
        let frame = render(&drawing, &camera);
        let reds = (45..83)
            .filter(|x| (62..66).any(|y| frame.pixel(*x, y).is_some_and(|p| p[0] > 120)))
            .count();
        assert_eq!(reds, if seen { 38 } else { 0 });
    }
}

#[test]
fn lines_are_seen_through_their_own_surface_only() {
    let (positions, triangles) = sphere(4);
    let wall = [
        [-0.1, -1.0, 2.0],
        [2.0, -1.0, 2.0],
        [2.0, 1.0, 2.0],
        [-0.1, 1.0, 2.0],
    ]
    .map(Point3::from);
    let wall = Surface::plain(&wall, &[[0, 1, 2], [0, 2, 3]], [0.0, 1.0, 0.0]);
    let muscle = Surface::plain(&positions, &triangles, [0.0, 0.0, 1.0]);
    let arc = |radius: f64| -> Vec<Vec<Point3<f64>>> {
        let point = |i: i32| {
            radius
                * Vector3::new(
                    (0.05 * f64::from(i)).sin(),
                    0.0,
                    (0.05 * f64::from(i)).cos(),
                )
        };
        vec![(-16..=16).map(|i| Point3::from(point(i))).collect()]
    };
    let (line, deeper) = (arc(0.9), arc(0.8));
    let inside = Lines::new(&line, [1.0, 0.0, 0.0]);
    // Columns with red in the left half, and in the right half behind the wall; and the redness of
    // the left half.
    let reds = |surfaces: [Surface; 2], lines: Lines| {
        let frame = render(&Drawing::of(surfaces).with_lines(lines), &front_camera(128));
        let red = |x: usize| {
            (62..66)
                .filter_map(|y| frame.pixel(x, y))
                .map(|p| p[0])
                .max()
                .unwrap_or(0)
        };
        let count = |columns: std::ops::Range<usize>| columns.filter(|x| red(*x) > 50).count();
        (count(30..50), count(78..98), red(50))
    };
    let seen = reds([muscle, wall], inside.seen_through(0));
    assert_eq!(
        reds([muscle, wall], inside),
        (0, 0, 0),
        "control: hidden in its surface"
    );
    assert_eq!((seen.0, seen.1), (20, 0));
    assert_eq!(reds([wall, muscle], inside.seen_through(1)), seen);
    assert_eq!(
        reds([muscle, wall], inside.seen_through(1)),
        (0, 0, 0),
        "the muscle is not its surface"
    );
    assert_eq!(
        reds([muscle, wall], inside.seen_through(2)),
        (0, 0, 0),
        "there is no such surface"
    );
    let faint = reds(
        [muscle, wall],
        Lines::new(&deeper, [1.0, 0.0, 0.0]).seen_through(0),
    )
    .2;
    assert!(
        0 < faint && faint < seen.2,
        "deeper is fainter: {faint} and {}",
        seen.2
    );
    // Translucent bone in front tints the line without hiding it.
    assert_eq!(
        reds([muscle, wall.with_opacity(0.3)], inside.seen_through(0)).1,
        20
    );
}

#[test]
fn what_is_not_finite_or_missing_is_dropped_and_counted() {
    let positions = [
        Point3::new(-1.0, -1.0, 0.0),
        Point3::new(1.0, -1.0, 0.0),
        Point3::new(0.0, 1.0, 0.0),
        Point3::new(f64::NAN, 0.0, 0.0),
        Point3::new(0.0, f64::INFINITY, 0.0),
    ];
    let triangles = [[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 1, 99], [1, 1, 1]];
    let line = vec![vec![positions[0], positions[3], positions[1]]];
    let drawing = Drawing::of([Surface::plain(&positions, &triangles, colour::BONE)])
        .with_lines(Lines::new(&line, colour::FIBRE));
    let view = View::orthographic(Vector3::z(), Vector3::y());
    let frame = render(&drawing, &Camera::fit(positions, &view, square_canvas(64)));
    assert_eq!(frame.dropped(), 3 + 2);
    assert!(dark(&frame, 32, 32));
}

#[test]
fn a_field_without_numbers_is_grey() {
    let positions = [
        Point3::new(-1.0, -1.0, 0.0),
        Point3::new(1.0, -1.0, 0.0),
        Point3::new(0.0, 1.0, 0.0),
    ];
    for values in [&[f64::NAN; 3][..], &[], &[1.0]] {
        let surface = Surface::field(
            &positions,
            &[[0, 1, 2]],
            values,
            (0.0, 1.0),
            ColourMap::Viridis,
        );
        let frame = render(&Drawing::of([surface]), &front_camera(32));
        let [r, g, b] = frame.pixel(16, 20).expect("inside");
        assert!(r == g && g == b && r < 255);
    }
}

fn number() -> impl Strategy<Value = f64> {
    let odd = vec![
        0.0,
        -0.0,
        1.0,
        -1.0,
        1e300,
        -1e300,
        f64::MAX,
        f64::MIN,
        1e-300,
        f64::NAN,
        f64::INFINITY,
        1e17,
    ];
    prop_oneof![3 => -2.0..2.0f64, 2 => prop::sample::select(odd), 1 => any::<f64>()]
}

fn any_point() -> impl Strategy<Value = Point3<f64>> {
    prop::array::uniform3(number()).prop_map(|[x, y, z]| Point3::new(x, y, z))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Arbitrary numbers: no panic, and coordinates that are not finite are counted.
    #[test]
    fn any_scene_can_be_drawn(points in prop::collection::vec(any_point(), 3..9), values in prop::collection::vec(number(), 0..9),
            indices in prop::collection::vec(prop::array::uniform3(0..10u32), 0..12), range in (number(), number()),
            opacity in any::<f32>(), size in (1..40u32, 1..40u32), width in number()) {
        let view = View::orthographic(Vector3::z(), Vector3::y());
        let surface = Surface::field(&points, &indices, &values, range, ColourMap::Viridis).with_opacity(opacity);
        let line = vec![points.clone()];
        let drawing = Drawing::of([surface]).with_lines(Lines { width, lift: width, ..Lines::new(&line, colour::FIBRE) });
        let bad = |i: u32| points.get(i as usize).is_none_or(|p| p.iter().any(|c| !c.is_finite()));
        let expected = indices.iter().filter(|t| t.iter().any(|i| bad(*i))).count()
            + (1..points.len()).filter(|i| bad(*i as u32) || bad(*i as u32 - 1)).count();
        for camera in [front_camera(size.0), Camera::fit(points.iter().copied(), &view, Canvas::new(size.0, size.1))] {
            prop_assert_eq!(render(&drawing, &camera).dropped(), expected);
        }
    }

    /// The order of triangles and surfaces never matters, opaque or translucent.
    #[test]
    fn order_never_shows(points in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 4..20),
            picks in prop::collection::vec(prop::array::uniform3(0..20usize), 1..20), turn in 0..20usize) {
        let points: Vec<Point3<f64>> = points.iter().map(|[x, y, z]| Point3::new(*x, *y, *z)).collect();
        // Each triangle has its own vertices and colour: shared ones would change their normals with the order.
        let alone: Vec<Vec<Point3<f64>>> = picks.iter().map(|t| t.map(|i| points[i % points.len()]).to_vec()).collect();
        let mut surfaces: Vec<Surface> = alone.iter().enumerate()
            .map(|(i, p)| Surface::plain(p, &[[0, 1, 2]], [0.1 + 0.04 * i as f32, 0.5, 0.9 - 0.04 * i as f32])
                .with_opacity(if i % 3 == 0 { 0.5 } else { 1.0 }))
            .collect();
        let before = render(&Drawing::of(surfaces.clone()), &front_camera(48));
        let count = surfaces.len();
        surfaces.rotate_left(turn % count);
        prop_assert_eq!(&render(&Drawing::of(surfaces.clone()), &front_camera(48)), &before);
        surfaces.reverse();
        prop_assert_eq!(&render(&Drawing::of(surfaces), &front_camera(48)), &before);
    }
}
