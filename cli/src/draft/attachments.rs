//! Which bones hold a muscle, by nearness.

use nalgebra::{Point3, Vector3};

use super::fit::long_axis;
use super::joint::Joint;
use super::part;
use pliant::contact::{Obstacle, Surface};
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::max_or_nan;

/// Distance from a bone within which a muscle is attached [mm].
pub const NEAR_MM: f64 = 3.0;

/// Greatest share of a muscle that one bone holds; for all bones together twice as much.
pub const LIMIT: f64 = 0.05;

/// Distance from a patch within which vertices are held, those of a remeshed muscle as well [mm].
pub const WITHIN_MM: f64 = 1.0;

/// A patch and what lies beside it hold this part of their share of the area: vertices of a remeshed muscle
/// are elsewhere.
const RIM: f64 = 0.9;

/// Parts of a muscle's length: its tip, and an end, which one side of the joint holds.
const TIP: f64 = 0.1;
const END: f64 = 0.35;

/// Greatest distance of an end from the bone that holds it, relative to the muscle's length. A mesh often
/// lacks its tendon.
const TENDON: f64 = 0.3;

/// An end of a muscle that a bone holds from afar.
#[derive(Clone, Debug, PartialEq)]
pub struct FarEnd {
    /// Its distance from the bone [mm].
    pub mm: f64,
    /// The middle of its tip [m].
    pub middle: Point3<f64>,
    /// The direction from the muscle's middle to the tip, along its length, and the length [m].
    pub outward: Vector3<f64>,
    pub length: f64,
    /// The bone that is nearest to the tip.
    pub nearest: Option<usize>,
    /// Whether a bone that rests holds it, although its tendon would cross the joint.
    pub lacks_tendon: bool,
}

/// The side of the bones that a joint turns.
const TURNS: usize = 1;

/// An attachment of a muscle to a bone.
#[derive(Clone, Debug, PartialEq)]
pub struct Attachment {
    /// Index of the bone.
    pub bone: usize,
    /// The triangles that it holds; `None` for all vertices within [`NEAR_MM`].
    pub patch: Option<Vec<u32>>,
    /// The end that it holds, where nothing is nearer.
    pub far: Option<FarEnd>,
}

impl Attachment {
    /// Whether a tendon from this end to its bone crosses a joint: a bone of the other side is nearer.
    pub fn crosses(&self, joint: &Joint) -> bool {
        let turns = |bone: usize| joint.turns.contains(&bone);
        let far = self.far.as_ref().filter(|far| far.mm > NEAR_MM);
        let nearest = far.and_then(|far| far.nearest);
        nearest.is_some_and(|nearest| turns(nearest) != turns(self.bone))
    }

    /// Lets another bone hold an end from afar, if a tendon can reach it.
    pub fn move_to(&mut self, bone: usize, surface: &Surface) {
        let Some(far) = &mut self.far else { return };
        let away = surface.closest(&far.middle).map(|c| c.distance);
        if let Some(away) = away.filter(|away| *away <= TENDON * far.length) {
            self.bone = bone;
            far.mm = 1e3 * away;
        }
    }
}

/// An end of a muscle that no bone holds.
#[derive(Clone, Debug, PartialEq)]
pub struct LooseEnd {
    /// The middle of its tip [m].
    pub at: Point3<f64>,
    /// The nearest bone, with its distance [mm].
    pub nearest: Option<(usize, f64)>,
}

/// A bone that is near to a muscle.
struct Near {
    bone: usize,
    /// Of each vertex, what orders those that the bone holds; infinite for others.
    keys: Vec<f64>,
    /// Whether it holds only a part of what is near.
    is_part: bool,
}

/// A muscle among its bones.
struct Around<'a> {
    mesh: &'a TriangleMesh,
    /// Distance of each vertex from each bone [mm].
    distances: Vec<Vec<f64>>,
    /// The side of each bone: bones of one side move together.
    sides: Vec<usize>,
    /// Whether the sides are those of a joint.
    turns: bool,
    /// Distance of each vertex from the one and from the other tip, relative to the length.
    from_tip: [Vec<f64>; 2],
    /// The direction from the other to the one tip.
    axis: Vector3<f64>,
    length: f64,
    /// The part of the area that belongs to each vertex [m2].
    areas: Vec<f64>,
}

/// The attachments of a muscle: at each end, to the bones of one side of the joint within [`NEAR_MM`] or, if
/// there are none, to the bone nearest to the tip. A bone that is near elsewhere is only passed. Also the
/// ends that are far from every bone. `turns` tells the bones that a joint turns; without a joint each bone
/// is a side of its own. Without a name that tells otherwise (`crosses`), a muscle crosses the joint.
pub fn find(
    muscle: &TriangleMesh,
    bones: &[Surface],
    turns: Option<&[usize]>,
    crosses: Option<bool>,
) -> (Vec<Attachment>, Vec<LooseEnd>) {
    let Some(around) = Around::new(muscle, bones, turns) else {
        return (Vec::new(), Vec::new());
    };
    let mut ends = [around.side_at(0), around.side_at(1)];
    // Ends that no bone touches, the nearer one first: the other one prefers another side.
    let mut open: Vec<usize> = (0..2).filter(|&e| ends[e].is_none()).collect();
    open.sort_by(|&a, &b| {
        around
            .to_tip(a, None)
            .map_or(f64::MAX, |n| n.1)
            .total_cmp(&around.to_tip(b, None).map_or(f64::MAX, |n| n.1))
    });
    let mut far = Vec::new();
    for e in open {
        let other = ends[1 - e].filter(|_| crosses != Some(false));
        let found = around
            .held_from_afar(e, other)
            .or(around.held_from_afar(e, None));
        ends[e] = found.map(|(bone, _)| around.sides[bone]);
        far.extend(found.map(|found| (e, found)));
    }
    // A muscle that lies along one side of a joint often reaches the other one by a tendon.
    if turns.is_some() && crosses != Some(false) && ends[0].is_some() && ends[0] == ends[1] {
        let each = (0..2).filter_map(|e| Some((e, around.held_from_afar(e, ends[e])?)));
        if let Some((e, found)) = each.min_by(|a, b| a.1.1.total_cmp(&b.1.1)) {
            ends[e] = Some(around.sides[found.0]);
            far.retain(|(end, _)| *end != e);
            far.push((e, found));
        }
    }
    let near = around.near(&ends, &far);
    // All bones together can fix a tenth of a muscle's vertices.
    let share = share(near.len() + far.len());
    let mut found = around.attachments(near, share);
    for (e, (bone, mm)) in far {
        found.push(Attachment {
            bone,
            patch: Some(around.patch(around.key_of_far(e, bone), share)),
            far: Some(FarEnd {
                mm,
                middle: around.middle_of_tip(e),
                outward: if e == 0 { around.axis } else { -around.axis },
                length: around.length,
                nearest: around.to_tip(e, None).map(|(bone, _)| bone),
                lacks_tendon: false,
            }),
        });
    }
    found.sort_by_key(|a| a.bone);
    let loose = (0..2).filter(|&e| ends[e].is_none());
    (found, loose.map(|e| around.loose(e)).collect())
}

/// The share of a muscle that each of several attachments holds.
pub fn share(attachments: usize) -> f64 {
    LIMIT.min(2.0 * LIMIT / attachments.max(1) as f64)
}

/// The distance of each vertex from a bone [mm].
fn distances_mm(mesh: &TriangleMesh, bone: &Surface) -> Vec<f64> {
    let to = |v: &Point3<f64>| bone.closest(v).map_or(f64::INFINITY, |c| c.distance.abs());
    mesh.vertices.iter().map(|v| 1e3 * to(v)).collect()
}

impl<'a> Around<'a> {
    fn new(mesh: &'a TriangleMesh, bones: &[Surface], turns: Option<&[usize]>) -> Option<Self> {
        let (middle, axis, length) = long_axis(&mesh.vertices)?;
        let side = |b: usize| turns.map_or(b, |turns| if turns.contains(&b) { TURNS } else { 0 });
        let from_tip = |sign: f64| -> Vec<f64> {
            let heights = mesh.vertices.iter().map(|v| sign * (v - middle).dot(&axis));
            let tip = max_or_nan(heights.clone());
            heights.map(|h| (tip - h) / length).collect()
        };
        Some(Self {
            mesh,
            distances: bones.iter().map(|bone| distances_mm(mesh, bone)).collect(),
            sides: (0..bones.len()).map(side).collect(),
            turns: turns.is_some(),
            from_tip: [from_tip(1.0), from_tip(-1.0)],
            axis: *axis,
            length,
            areas: mesh.vertex_areas(),
        })
    }

    fn is_near(&self, bone: usize, v: usize) -> bool {
        self.distances[bone][v] <= NEAR_MM
    }

    /// The vertices within this share of the length from a tip.
    fn within(&self, end: usize, share: f64) -> impl Iterator<Item = usize> {
        let from = &self.from_tip[end];
        (0..from.len()).filter(move |&v| from[v] <= share)
    }

    /// The side of the bone that is near most closely to the tip of an end.
    fn side_at(&self, end: usize) -> Option<usize> {
        let near = |b: usize| self.within(end, END).filter(move |&v| self.is_near(b, v));
        let each = (0..self.sides.len()).flat_map(|b| near(b).map(move |v| (b, v)));
        let nearest =
            each.min_by(|a, b| self.from_tip[end][a.1].total_cmp(&self.from_tip[end][b.1]));
        nearest.map(|(bone, _)| self.sides[bone])
    }

    /// The bone that is nearest to a tip, but none of the side `but`, with its distance [mm].
    fn to_tip(&self, end: usize, but: Option<usize>) -> Option<(usize, f64)> {
        let bones = (0..self.sides.len()).filter(|&b| Some(self.sides[b]) != but);
        let each = bones.map(|b| {
            let least = |least: f64, v: usize| match self.distances[b][v] < least {
                true => self.distances[b][v],
                false => least,
            };
            (b, self.within(end, TIP).fold(f64::INFINITY, least))
        });
        each.filter(|(_, mm)| mm.is_finite())
            .min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The same, if a tendon can reach it.
    fn held_from_afar(&self, end: usize, but: Option<usize>) -> Option<(usize, f64)> {
        self.to_tip(end, but)
            .filter(|(_, mm)| *mm <= 1e3 * TENDON * self.length)
    }

    /// The bones that are near, each with the vertices that it holds, by a key that orders them, and
    /// whether it holds all that is near. A bone holds what is near to it in the half with the end of its
    /// side. An insertion is narrow: of what is near to a bone that turns, it is what is nearest to the tip.
    fn near(&self, ends: &[Option<usize>; 2], far: &[(usize, (usize, f64))]) -> Vec<Near> {
        let mut found = Vec::new();
        let most = self.most(LIMIT);
        for (bone, &side) in self.sides.iter().enumerate() {
            // The distance from the tip of the end that holds a vertex.
            let from_own_tip = |v: usize| {
                let own = (0..2).filter(|&e| {
                    let is_far = far.iter().any(|(other, _)| *other == e);
                    ends[e] == Some(side) && !is_far && self.from_tip[e][v] <= 0.5
                });
                own.map(|e| self.from_tip[e][v]).next()
            };
            let near = (0..self.mesh.vertices.len()).filter(|&v| self.is_near(bone, v));
            let (own, passed): (Vec<usize>, Vec<usize>) =
                near.partition(|&v| from_own_tip(v).is_some());
            if own.is_empty() {
                continue;
            }
            let is_insertion = self.turns && side == TURNS;
            let key = |v: usize| match from_own_tip(v).filter(|_| self.is_near(bone, v)) {
                Some(from) if is_insertion => from,
                Some(_) => self.distances[bone][v],
                None => f64::INFINITY,
            };
            found.push(Near {
                bone,
                keys: (0..self.mesh.vertices.len()).map(key).collect(),
                is_part: !passed.is_empty() || is_insertion && own.len() > most,
            });
        }
        found
    }

    /// What orders the vertices of an end that a bone holds from afar. Where the end touches the bone after
    /// all, it is the distance from it: the tip along the length can lie elsewhere, as that of a tendon which
    /// goes round a head. Otherwise it is the distance from the tip, but what slides on a bone of another
    /// side is not held, unless nothing is left.
    fn key_of_far(&self, end: usize, bone: usize) -> impl Fn(usize) -> f64 {
        let touches = self.within(end, END).any(|v| self.is_near(bone, v));
        let others = (0..self.sides.len()).filter(|&b| self.sides[b] != self.sides[bone]);
        let others: Vec<usize> = others.filter(|_| self.turns).collect();
        let slides = move |v: usize| others.iter().any(|&b| self.is_near(b, v));
        let is_free = !touches && self.within(end, TIP).any(|v| !slides(v));
        move |v| {
            let from = self.from_tip[end][v];
            match touches {
                true if from <= END && self.is_near(bone, v) => self.distances[bone][v],
                false if !is_free || from <= END && !slides(v) => from,
                _ => f64::INFINITY,
            }
        }
    }

    /// The attachments to bones that are near, each of at most a `share` of the muscle.
    fn attachments(&self, near: Vec<Near>, share: f64) -> Vec<Attachment> {
        let one = |near: Near| Attachment {
            bone: near.bone,
            patch: near.is_part.then(|| self.patch(|v| near.keys[v], share)),
            far: None,
        };
        near.into_iter().map(one).collect()
    }

    /// The greatest number of vertices of a share of all.
    fn most(&self, share: f64) -> usize {
        ((share * self.mesh.vertices.len() as f64) as usize).max(3)
    }

    /// The triangles between the vertices with the least keys, up to a share of all vertices and of the
    /// whole area; or around them, if none lies between.
    fn patch(&self, key: impl Fn(usize) -> f64, share: f64) -> Vec<u32> {
        let mut order: Vec<usize> = (0..self.mesh.vertices.len())
            .filter(|&v| key(v).is_finite())
            .collect();
        order.sort_by(|&a, &b| key(a).total_cmp(&key(b)).then(a.cmp(&b)));
        order.truncate(self.most(share));
        let most = RIM * share * self.areas.iter().sum::<f64>();
        loop {
            let patch = self.between(&order);
            let held = self.held_by(&patch);
            // Few vertices are the least patch.
            if order.len() <= self.most(0.0) || !(held > most) {
                return patch;
            }
            // What is held beyond a patch falls with its size as well, but not as fast.
            let fewer = (0.95 * most / held * order.len() as f64) as usize;
            order.truncate(fewer.max(self.most(0.0)));
        }
    }

    /// The triangles between some vertices; or around them, if none lies between.
    fn between(&self, vertices: &[usize]) -> Vec<u32> {
        let mut is_in = vec![false; self.mesh.vertices.len()];
        vertices.iter().for_each(|&v| is_in[v] = true);
        let corners = |t: &[u32; 3]| t.iter().filter(|v| is_in[**v as usize]).count();
        let with = |least: usize| -> Vec<u32> {
            let all = self.mesh.triangles.iter().enumerate();
            all.filter(|(_, t)| corners(t) >= least)
                .map(|(t, _)| t as u32)
                .collect()
        };
        let between = with(3);
        if between.is_empty() { with(1) } else { between }
    }

    /// The area of the vertices that a patch holds: on it and within [`WITHIN_MM`] [m2]. Beside a patch of
    /// fine triangles, or one of many pieces, these are many.
    fn held_by(&self, patch: &[u32]) -> f64 {
        let surface = Surface::new(&part(self.mesh, patch));
        let distances = distances_mm(self.mesh, &surface);
        let held = distances.iter().zip(&self.areas);
        held.filter(|(mm, _)| **mm <= WITHIN_MM)
            .map(|(_, area)| area)
            .sum()
    }

    fn middle_of_tip(&self, end: usize) -> Point3<f64> {
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        for v in self.within(end, TIP) {
            sum += self.mesh.vertices[v].coords;
            count += 1.0;
        }
        (sum / count).into()
    }

    fn loose(&self, end: usize) -> LooseEnd {
        LooseEnd {
            at: self.middle_of_tip(end),
            nearest: self.to_tip(end, None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::mesh::shapes::{box_surface, icosphere};

    fn block(x: f64, height: f64) -> Surface {
        let mut block = box_surface([0.1, 0.1, 0.02], 0.01);
        block.vertices.iter_mut().for_each(|v| {
            v.x += x;
            v.z += height;
        });
        Surface::new(&block)
    }

    fn spindle() -> TriangleMesh {
        spindle_of(3)
    }

    /// A spindle along z, 0.2 m long and 0.04 m thick.
    fn spindle_of(divisions: u32) -> TriangleMesh {
        let mut mesh = icosphere(0.1, divisions);
        mesh.vertices
            .iter_mut()
            .for_each(|v| (v.x, v.y) = (0.2 * v.x, 0.2 * v.y));
        mesh
    }

    /// Heights of the triangles of a patch.
    fn heights(attachment: &Attachment) -> Vec<f64> {
        let mesh = spindle();
        let triangles = attachment.patch.as_ref().expect("a patch").iter();
        triangles.map(|&t| mesh.corners(t as usize)[0].z).collect()
    }

    #[test]
    fn bones_near_both_ends_hold() {
        let bones = [block(0.0, 0.111), block(0.0, -0.111)];
        for turns in [None, Some(&[1_usize][..])] {
            let (found, loose) = find(&spindle(), &bones, turns, None);
            assert_eq!((found.len(), loose.len()), (2, 0), "{turns:?}");
            assert!(found.iter().all(|a| a.patch.is_none() && a.far.is_none()));
        }
    }

    #[test]
    fn an_end_without_a_tendon_is_held_from_afar_and_not_from_farther() {
        let bones = [block(0.0, 0.111), block(0.0, -0.14)];
        let (found, loose) = find(&spindle(), &bones, None, None);
        assert_eq!((found.len(), loose.len()), (2, 0));
        let mm = found[1].far.as_ref().expect("from afar").mm;
        assert!((mm - 30.0).abs() <= 0.1, "{mm}");
        assert!(heights(&found[1]).iter().all(|z| *z <= -0.07));
        // Control: nothing is within three tenths of its length.
        let bones = [block(0.0, 0.111), block(0.0, -0.2)];
        let (found, loose) = find(&spindle(), &bones, None, None);
        assert_eq!((found.len(), loose.len()), (1, 1));
        assert!(loose[0].at.z < -0.08);
        assert_eq!(loose[0].nearest.map(|n| n.0), Some(1));
        assert_eq!(find(&spindle(), &[], None, None).1.len(), 2);
    }

    /// The corners of a patch of a mesh, and the distances of the nearest from a bone [mm].
    fn away(mesh: &TriangleMesh, attachment: &Attachment, bone: &Surface) -> Vec<f64> {
        let triangles = attachment.patch.as_ref().expect("a patch").iter();
        let corners = triangles.flat_map(|&t| mesh.corners(t as usize));
        let to = |x| bone.closest(&x).map(|c| 1e3 * c.distance.abs());
        corners.filter_map(to).collect()
    }

    #[test]
    fn another_bone_holds_an_end_from_afar_if_a_tendon_can_reach_it() {
        let bones = [block(0.0, 0.111), block(0.0, -0.14), block(0.09, -0.14)];
        let (mut found, _) = find(&spindle(), &bones[..2], Some(&[1]), None);
        let there = found[1].clone();
        found[1].move_to(2, &bones[2]);
        assert_eq!((there.bone, found[1].bone), (1, 2));
        let mm = found[1].far.as_ref().expect("from afar").mm;
        assert!(
            mm > there.far.as_ref().expect("from afar").mm + 10.0,
            "{mm}"
        );
        // Controls: a bone out of reach, and an end that touches its bone.
        found[1].move_to(0, &bones[0]);
        assert_eq!(found[1].bone, 2);
        found[0].move_to(2, &bones[2]);
        assert_eq!(found[0].bone, 0);
    }

    #[test]
    fn what_slides_on_another_bone_is_not_held_from_afar() {
        // A bone that rests touches the flank of the lower end, which a bone that turns holds from below.
        let bones = [block(0.0, 0.111), block(0.0, -0.14), block(0.0615, -0.085)];
        let mesh = spindle_of(5);
        let held = |bones: &[Surface]| {
            let (found, _) = find(&mesh, bones, Some(&[1]), None);
            found.into_iter().find(|a| a.bone == 1).expect("it holds")
        };
        let found = held(&bones);
        assert!(found.far.is_some());
        let least = away(&mesh, &found, &bones[2]).into_iter();
        let least = least.fold(f64::INFINITY, f64::min);
        assert!(least > NEAR_MM, "{least}");
        let without = away(&mesh, &held(&bones[..2]), &bones[2]);
        assert!(without.iter().any(|mm| *mm <= NEAR_MM), "control");
    }

    #[test]
    fn a_bone_that_touches_an_end_after_all_holds_what_is_near_to_it() {
        // A bone that turns lies along the whole bar, and one that rests touches its other flank.
        let bar = box_surface([0.04, 0.04, 0.2], 0.005);
        let boxed = |size, x, z| {
            let mut mesh = box_surface(size, 0.01);
            mesh.vertices.iter_mut().for_each(|v| {
                v.x += x;
                v.z += z;
            });
            Surface::new(&mesh)
        };
        let bones = [
            boxed([0.02, 0.04, 0.2], -0.031, 0.0),
            boxed([0.02, 0.02, 0.03], 0.031, -0.07),
        ];
        let (found, _) = find(&bar, &bones, Some(&[0]), None);
        let found = found.iter().find(|a| a.bone == 1).expect("it holds");
        let farthest = max_or_nan(away(&bar, found, &bones[1]));
        assert!(farthest <= NEAR_MM, "{farthest}");
    }

    #[test]
    fn a_patch_and_what_lies_beside_it_hold_their_share() {
        let bones = [block(0.0, 0.13), block(0.0, -0.13)];
        // The finest has the edges of a segmentation: its patches hold a rim beside them.
        for divisions in [3, 4, 5, 6] {
            let mesh = spindle_of(divisions);
            let around = Around::new(&mesh, &bones, None).expect("a muscle");
            let whole: f64 = around.areas.iter().sum();
            let (found, _) = find(&mesh, &bones, None, None);
            assert_eq!(found.len(), 2);
            for attachment in found {
                let held = around.held_by(&attachment.patch.expect("a patch")) / whole;
                assert!(held <= LIMIT, "{divisions}: {held}");
                // At a tip, where triangles are small, the number of vertices ends it before the area does.
                assert!(held >= 0.4 * LIMIT, "{divisions}: {held}");
            }
        }
    }

    #[test]
    fn a_bone_that_is_only_passed_does_not_hold() {
        // The second bone touches the flank beside the upper end, and the third is far below.
        let bones = [block(0.0, 0.111), block(0.0645, 0.03), block(0.0, -0.14)];
        let (found, _) = find(&spindle(), &bones, Some(&[1, 2]), None);
        let holders: Vec<usize> = found.iter().map(|a| a.bone).collect();
        assert_eq!(holders, [0, 2]);
        // One that turns and also touches the lower end holds that end alone.
        let mut long = box_surface([0.02, 0.1, 0.2], 0.01);
        long.vertices.iter_mut().for_each(|v| {
            v.x += 0.0305;
            v.z -= 0.04;
        });
        let bones = [block(0.0, 0.111), block(0.0, -0.111), Surface::new(&long)];
        let (found, _) = find(&spindle(), &bones, Some(&[1, 2]), None);
        let third = found.iter().find(|a| a.bone == 2).expect("it holds");
        assert!(
            heights(third).iter().all(|z| *z <= 0.02),
            "{:?}",
            heights(third)
        );
        // One that rests holds a part of what is near, and nothing else, although a patch could be larger.
        let (found, _) = find(&spindle(), &bones, Some(&[1]), None);
        let third = found.iter().find(|a| a.bone == 2).expect("it holds");
        let triangles = third.patch.as_ref().expect("a patch").iter();
        let corners = triangles.flat_map(|&t| spindle().corners(t as usize));
        let away = corners.filter_map(|x| bones[2].closest(&x).map(|c| c.distance.abs()));
        assert!(1e3 * max_or_nan(away) <= NEAR_MM);
    }

    #[test]
    fn an_insertion_is_what_is_nearest_to_the_tip() {
        // A bone lies along the lower 8 cm of a bar.
        let bar = box_surface([0.04, 0.04, 0.2], 0.005);
        let mut shaft = box_surface([0.02, 0.04, 0.08], 0.01);
        shaft.vertices.iter_mut().for_each(|v| {
            v.x += 0.031;
            v.z -= 0.06;
        });
        let bones = [block(0.0, 0.111), Surface::new(&shaft)];
        let highest_held = |turns: &[usize]| {
            let (found, _) = find(&bar, &bones, Some(turns), None);
            let shaft = found.into_iter().find(|a| a.bone == 1).expect("it holds");
            shaft.patch.map(|patch| {
                let corners = patch.iter().flat_map(|&t| bar.corners(t as usize));
                corners.map(|x| x.z).fold(f64::NEG_INFINITY, f64::max)
            })
        };
        let highest = highest_held(&[1]).expect("a part of what is near");
        assert!(highest <= -0.05, "{highest}");
        // Control: a bone that rests holds all that is near.
        assert_eq!(highest_held(&[0]), None);
    }

    #[test]
    fn what_lies_along_one_side_reaches_the_other_by_a_tendon() {
        // A bone along the whole muscle, and one beyond its lower end.
        let mut shaft = box_surface([0.02, 0.02, 0.2], 0.01);
        shaft.vertices.iter_mut().for_each(|v| v.x += 0.031);
        // The spindle touches the shaft at its middle alone, so that both tips are as near to it.
        let bones = [Surface::new(&shaft), block(0.0, -0.14)];
        let (found, loose) = find(&spindle(), &bones, Some(&[1]), None);
        assert!(loose.is_empty());
        let far = found.iter().find(|a| a.bone == 1).expect("the other side");
        assert!(heights(far).iter().all(|z| *z <= -0.07));
        // Not if its name tells that it does not cross the joint.
        let (found, loose) = find(&spindle(), &bones, Some(&[1]), Some(false));
        let holders: Vec<usize> = found.iter().map(|a| a.bone).collect();
        assert_eq!((holders, loose.len()), (vec![0], 0));
    }
}
