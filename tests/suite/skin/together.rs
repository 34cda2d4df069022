//! Several implants under a common skin.

use nalgebra::Point3;
use pliant::skin::{
    Group, ImplantPlace, ImplantSpec, Inserted, PreparedPatch, SkinError, deepest, grouped,
};

use super::shapes::sheet;
use super::sunk;
use crate::tolerances::T6;

const BASE: f64 = 0.03;

/// Orders of round implants at places along x [m] of a sheet, with volumes [m^3].
fn orders(at: &[(f64, f64)]) -> Vec<ImplantSpec> {
    let order = |&(x, volume): &(f64, f64)| {
        let place = ImplantPlace::Point(Point3::new(x, 0.0, 0.0));
        ImplantSpec {
            edge: Some(2.5e-3),
            ..ImplantSpec::round(place, BASE, volume)
        }
    };
    at.iter().map(order).collect()
}

fn groups(at: &[(f64, f64)]) -> Result<Vec<Group>, (usize, SkinError)> {
    grouped(
        &sheet(80, 0.2),
        &orders(at),
        |_| Vec::new(),
        &pliant::progress::Silent,
    )
}

fn settled(ready: &PreparedPatch) -> Inserted {
    let done = ready
        .insert_after(None, &ready.volumes(), |_| true)
        .expect("settled");
    println!("{:?}, {:?}", done.progress, done.areas);
    assert!(done.progress.converged, "{:?}", done.progress);
    assert!(
        done.progress.depth <= deepest(BASE),
        "{} m",
        done.progress.depth
    );
    assert!(
        sunk(ready, &done, &done.x) <= deepest(BASE),
        "{} m",
        sunk(ready, &done, &done.x)
    );
    for (shell, volume) in done.shells.iter().zip(ready.volumes()) {
        assert!(
            (shell.volume / volume - 1.0).abs() <= T6,
            "{} of {volume} m3",
            shell.volume
        );
    }
    done
}

#[test]
fn implants_that_share_skin_press_on_each_other() {
    let (far, near, volume) = (0.07, 0.016, 4e-6);
    let apart = groups(&[(-far, volume), (far, volume)]).expect("regions");
    assert_eq!(
        apart.iter().map(|g| g.1.clone()).collect::<Vec<_>>(),
        [vec![0], vec![1]]
    );
    let alone: Vec<Inserted> = apart.iter().map(|(ready, _)| settled(ready)).collect();
    let together = groups(&[(-near, volume), (near, volume)]).expect("a region");
    let [(ready, members)] = &together[..] else {
        panic!("one group")
    };
    assert_eq!(members, &[0, 1]);
    let done = settled(ready);
    // Quantities equal on both sides are found equal, except for the asymmetry of the mesh.
    let [left, right] = &done.shells[..] else {
        panic!("two shells")
    };
    assert!(
        (left.pressure / right.pressure - 1.0).abs() <= 0.02,
        "{} and {} Pa",
        left.pressure,
        right.pressure
    );
    let middle = |shell| {
        done.shell_at(shell).iter().map(|p| p.x).sum::<f64>() / done.shell_at(shell).len() as f64
    };
    let middles = [middle(left), middle(right)];
    // Without friction only the mesh determines their positions: to half an edge.
    assert!(
        (middles[0] + middles[1]).abs() <= 0.5 * 2.5e-3 && middles[1] > 0.3 * BASE,
        "{middles:?}"
    );
    // Both implants lift the skin between them, so it stretches less than over two separate
    // domes.
    let sum: f64 = alone.iter().map(|done| done.areas.gain()).sum();
    let gain = done.areas.gain();
    assert!(
        gain > 1.05 * alone[0].areas.gain() && gain < sum,
        "{gain} m2, alone {sum}"
    );
    assert!(done.areas.volume_difference > 2.0 * volume);
    // Neither implant penetrates the other. Control: an implant moved into the other is deep in
    // it.
    let mut moved = done.x.clone();
    moved[left.vertices.clone()]
        .iter_mut()
        .for_each(|p| p.x += BASE);
    assert!(sunk(ready, &done, &done.x) <= deepest(BASE));
    assert!(sunk(ready, &done, &moved) > 0.1 * BASE);
}

#[test]
fn an_implant_is_the_same_in_whatever_order_it_is_named() {
    let (small, large) = ((-0.02, 2e-6), (0.018, 6e-6));
    let gains = [[small, large], [large, small]].map(|at| {
        let groups = groups(&at).expect("a region");
        let done = settled(&groups[0].0);
        (done.areas.gain(), pressures(&done))
    });
    // The smaller implant has a different pressure, but it is the same implant.
    assert!((gains[0].0 / gains[1].0 - 1.0).abs() <= 2e-3, "{gains:?}");
    assert!(
        (gains[0].1[0] / gains[1].1[1] - 1.0).abs() <= 0.02,
        "{gains:?}"
    );
    assert!(
        (gains[0].1[1] / gains[1].1[0] - 1.0).abs() <= 0.02,
        "{gains:?}"
    );
}

fn pressures(done: &Inserted) -> Vec<f64> {
    done.shells.iter().map(|shell| shell.pressure).collect()
}

#[test]
fn implants_in_one_another_are_refused() {
    let Err((number, error)) = groups(&[(-0.07, 4e-6), (0.0, 4e-6), (0.5 * BASE, 4e-6)]) else {
        panic!("accepted")
    };
    assert!(
        matches!(
            error,
            SkinError::Overlap {
                first: 2,
                second: 3
            }
        ) && number == 2,
        "{number}: {error}"
    );
    assert!(error.help().contains("apart"));
    // Touching bases are as near as may be.
    assert!(groups(&[(0.0, 4e-6), (1.01 * BASE, 4e-6)]).is_ok());
}

#[test]
fn no_skin_is_in_two_groups() {
    // The joint patch of the first two has longer edges than that of the second alone, and meets the third where that did not.
    let order = |x: f64, y: f64, base: f64| {
        let place = ImplantPlace::Point(Point3::new(x, y, 0.0));
        ImplantSpec::round(place, base, 0.05 * base * base * base)
    };
    let skin = sheet(80, 0.2);
    for y in [0.0, 1e-3, 1.87e-3, 3e-3, 6e-3] {
        let all = [
            order(-0.05, -0.05, 0.06),
            order(0.03, -0.05, 0.03),
            order(0.07, y, 0.03),
        ];
        let groups =
            grouped(&skin, &all, |_| Vec::new(), &pliant::progress::Silent).expect("regions");
        let mut owners = vec![0; skin.triangles.len()];
        for (ready, _) in &groups {
            let mut inside = vec![1; skin.triangles.len()];
            ready.outside.iter().for_each(|t| inside[*t as usize] = 0);
            owners
                .iter_mut()
                .zip(inside)
                .for_each(|(all, own)| *all += own);
        }
        assert!(
            owners.iter().all(|owners| *owners <= 1),
            "{y}: {} groups",
            groups.len()
        );
        let mut members: Vec<usize> = groups
            .into_iter()
            .flat_map(|(_, members)| members)
            .collect();
        members.sort_unstable();
        assert_eq!(members, [0, 1, 2]);
    }
}
