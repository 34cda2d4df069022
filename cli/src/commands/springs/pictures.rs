//! Pictures of a spring system: springs as lines, coloured by their strain, behind a cut through
//! the middle.

use nalgebra::{Point3, Vector3};

use pliant::mesh::measures::{Aabb, max_or_nan};
use pliant_render::{
    Camera, Canvas, ColourMap, Drawing, Legend, Lines, PictureError, Rgb, TextStyle, View, render,
};

/// Width and height [px].
const SIZE: (u32, u32) = (900, 720);
/// Greatest number of springs in a picture: more hide each other. Those nearest to the cut are
/// drawn.
const MOST: usize = 4000;
/// Number of colours: a line has one, so springs of nearly equal strain are drawn together.
const CLASSES: usize = 24;
const INK: Rgb = [0.16, 0.17, 0.19];

/// Springs of nearly equal strain, with their colour.
type Class = (Vec<Vec<Point3<f64>>>, Rgb);

/// The visible springs of a system.
pub(super) struct Shown {
    ends: Vec<[usize; 2]>,
    rest: Vec<f64>,
}

impl Shown {
    /// Springs behind the plane through the middle across y, for a system at `x` [m]; all if there
    /// are none.
    pub(super) fn behind_cut(x: &[Point3<f64>], ends: &[[u32; 2]], rest: &[f64]) -> Self {
        let bounds = Aabb::of_points(x);
        let middle = nalgebra::center(&bounds.min, &bounds.max).y;
        // A plane of points in the middle counts as behind, for any rounding of its coordinates.
        let rounded = 1e-9 * bounds.extents().max();
        let y = |s: usize| ends[s].map(|p| x[p as usize].y - middle + rounded);
        let mut shown: Vec<usize> = (0..ends.len())
            .filter(|&s| y(s).iter().all(|y| *y >= 0.0))
            .collect();
        if shown.is_empty() {
            shown = (0..ends.len()).collect();
        }
        if shown.len() > MOST {
            // Whole layers behind the cut, unless one is too large.
            let depth = |s: usize| y(s)[0].max(y(s)[1]);
            shown.sort_by(|&a, &b| depth(a).total_cmp(&depth(b)));
            let next = depth(shown[MOST]) - 2.0 * rounded;
            let whole = shown.partition_point(|&s| depth(s) < next);
            shown.truncate(if whole > 0 { whole } else { MOST });
        }
        let ends_of = |s: &usize| ends[*s].map(|p| p as usize);
        Self {
            ends: shown.iter().map(ends_of).collect(),
            rest: shown.iter().map(|s| rest[*s]).collect(),
        }
    }

    /// Strain of each spring; NaN for rest length 0.
    fn strains(&self, x: &[Point3<f64>]) -> Vec<f64> {
        let strain = |([a, b], rest): (&[usize; 2], &f64)| match *rest > 0.0 {
            true => (x[*a] - x[*b]).norm() / rest - 1.0,
            false => f64::NAN,
        };
        self.ends.iter().zip(&self.rest).map(strain).collect()
    }

    /// One picture for each state of the points, with a common colour scale.
    ///
    /// # Errors
    /// Errors of the encoder.
    pub(super) fn pictures(
        &self,
        states: &[(&str, &[Point3<f64>])],
    ) -> Result<Vec<Vec<u8>>, PictureError> {
        let strains: Vec<Vec<f64>> = states.iter().map(|(_, x)| self.strains(x)).collect();
        let known = || strains.iter().flatten().copied().filter(|s| s.is_finite());
        let (least, most) = (-max_or_nan(known().map(|s| -s)), max_or_nan(known()));
        // If strains differ by rounding only, the colours should show that.
        let range = if most - least > 1e-6 {
            (least, most)
        } else {
            (least - 5e-7, most + 5e-7)
        };
        let legend = Legend::new("Strain", "", range, ColourMap::Viridis).large();
        let canvas = Canvas::new(SIZE.0, SIZE.1)
            .with_right(legend.width())
            .with_top(20.0);
        let view = View::orthographic(Vector3::new(0.55, -1.0, 0.5), Vector3::z());
        let all = states
            .iter()
            .flat_map(|(_, x)| self.ends.iter().flatten().map(|p| x[*p]));
        let camera = Camera::fit(all, &view, canvas);
        let each = states.iter().zip(&strains).map(|((title, x), strains)| {
            let classes = self.classes(x, strains, range);
            let mut drawing = Drawing::of([]);
            for (lines, colour) in &classes {
                drawing = drawing.with_lines(Lines::new(lines, *colour));
            }
            let mut frame = render(&drawing, &camera);
            legend.draw(&mut frame);
            frame.text(12, 10, title, TextStyle::Title, INK);
            frame.to_png()
        });
        each.collect()
    }

    /// Springs without a strain are the last class.
    fn classes(&self, x: &[Point3<f64>], strains: &[f64], range: (f64, f64)) -> Vec<Class> {
        let colour = |class: usize| {
            let t = if class < CLASSES {
                (class as f64 + 0.5) / CLASSES as f64
            } else {
                f64::NAN
            };
            ColourMap::Viridis.colour(t)
        };
        let mut classes: Vec<_> = (0..=CLASSES)
            .map(|class| (Vec::new(), colour(class)))
            .collect();
        for ([a, b], strain) in self.ends.iter().zip(strains) {
            let place = ColourMap::place(*strain, range);
            let class = if place.is_nan() {
                CLASSES
            } else {
                ((place * CLASSES as f64) as usize).min(CLASSES - 1)
            };
            classes[class].0.push(vec![x[*a], x[*b]]);
        }
        classes
    }
}
