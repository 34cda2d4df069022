//! Pictures of the hierarchy of boxes over a mesh, by levels.

use std::io::Write;
use std::path::{Path, PathBuf};

use nalgebra::{Point3, Vector3};

use super::super::failure::Failure;
use pliant::contact::Surface as Hierarchy;
use pliant::io::{file_name, write_whole};
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::Aabb;
use pliant_render::{
    Camera, Canvas, Drawing, Frame, Lines, Rgb, Surface, TextStyle, View, colour, render,
};

/// Width and height of a level [px], levels beside each other, and distance of pictures [px].
const SIZE: (u32, u32) = (420, 420);
const BESIDE: usize = 3;
const GAP: usize = 6;

/// Number of levels that are drawn: of more every second, third and so on.
const MOST: usize = 9;

/// Greatest number of boxes of a level: more hide the surface.
const MOST_BOXES: usize = 512;

const INK: Rgb = [0.16, 0.17, 0.19];
const BOX: Rgb = [0.13, 0.36, 0.66];

/// The edges of a box.
fn edges(bounds: &Aabb) -> Vec<Vec<Point3<f64>>> {
    let (a, b) = (bounds.min, bounds.max);
    let bottom = [a.y, b.y].map(|y| [Point3::new(a.x, y, a.z), Point3::new(b.x, y, a.z)]);
    let ring = |z: f64| {
        let [[p, q], [s, r]] = bottom.map(|row| row.map(|p| Point3::new(p.x, p.y, z)));
        vec![p, q, r, s, p]
    };
    let mut lines = vec![ring(a.z), ring(b.z)];
    let corners = bottom.into_iter().flatten();
    lines.extend(corners.map(|p| vec![p, Point3::new(p.x, p.y, b.z)]));
    lines
}

/// The picture of a mesh: some levels, each with its boxes over the surface.
fn picture(mesh: &TriangleMesh) -> Frame {
    let levels = Hierarchy::new(mesh).boxes_by_level(MOST_BOXES);
    let each = levels.len().div_ceil(MOST).max(1);
    let canvas = Canvas::new(SIZE.0, SIZE.1).with_top(24.0);
    let view = View::orthographic(Vector3::new(0.6, 0.45, 1.0), Vector3::y());
    let whole = levels.iter().take(1).flatten().flat_map(edges);
    let camera = Camera::fit(whole.flatten(), &view, canvas);
    let mut frames = Vec::new();
    for (level, boxes) in levels.iter().enumerate().step_by(each) {
        let lines: Vec<_> = boxes.iter().flat_map(edges).collect();
        let surface = Surface::plain(&mesh.vertices, &mesh.triangles, colour::MUSCLE);
        let drawing = Drawing::of([surface]).with_lines(Lines::new(&lines, BOX));
        let mut frame = render(&drawing, &camera);
        let title = match boxes.len() {
            1 => format!("level {level}: 1 box"),
            count => format!("level {level}: {count} boxes"),
        };
        frame.text(10, 8, &title, TextStyle::Title, INK);
        frames.push(frame);
    }
    let white = [1.0; 3];
    let rows: Vec<Frame> = frames
        .chunks(BESIDE)
        .map(|row| Frame::beside(row, GAP, white))
        .collect();
    below_each_other(&rows, white)
}

fn below_each_other(rows: &[Frame], colour: Rgb) -> Frame {
    let width = rows.iter().map(Frame::width).max().unwrap_or(1);
    let height: usize = rows.iter().map(|row| row.height() + GAP).sum();
    let mut all = Frame::plain(width as u32, height.max(1) as u32, colour);
    let mut top = 0;
    for row in rows {
        all.paste(0, top, row);
        top += row.height() + GAP;
    }
    all
}

/// Writes the picture of each file that is a mesh into a folder. Returns their paths.
pub(super) fn write(folder: &Path, meshes: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let failed = |path: &Path, error: &dyn std::fmt::Display| {
        let message = format!("{}: cannot be written: {error}", path.display());
        Failure::usage(message, "name another folder")
    };
    std::fs::create_dir_all(folder).map_err(|error| failed(folder, &error))?;
    let mut written: Vec<PathBuf> = Vec::new();
    for file in meshes {
        // What cannot be read has its message already.
        let Ok(read) = pliant::io::read(file) else {
            continue;
        };
        if read.mesh.triangles.is_empty() {
            continue;
        }
        let stem = file
            .file_stem()
            .unwrap_or(file.as_os_str())
            .to_string_lossy();
        let mut path = folder.join(format!("{}-hierarchy.png", file_name(&stem)));
        // Files of one name in several folders.
        let mut next = 2;
        while written.contains(&path) {
            path = folder.join(format!("{}-{next}-hierarchy.png", file_name(&stem)));
            next += 1;
        }
        let png = picture(&read.mesh)
            .to_png()
            .map_err(|error| failed(&path, &error))?;
        write_whole(&path, |w| w.write_all(&png)).map_err(|error| failed(&path, &error))?;
        written.push(path);
    }
    Ok(written)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::mesh::shapes::make;

    #[test]
    fn each_level_covers_the_surface_and_is_finer_than_the_one_before() {
        let mesh = make("icosphere").expect("a shape").mesh;
        let levels = Hierarchy::new(&mesh).boxes_by_level(100);
        assert!(levels.len() > 4 && levels.iter().all(|boxes| boxes.len() <= 100));
        assert_eq!(levels[0].len(), 1);
        for pair in levels.windows(2) {
            assert!(pair[0].len() < pair[1].len());
        }
        for boxes in &levels {
            let inside = |b: &Aabb, p: &Point3<f64>| b.min <= *p && *p <= b.max;
            let is_covered = |p: &Point3<f64>| boxes.iter().any(|b| inside(b, p));
            assert!(mesh.vertices.iter().all(is_covered));
        }
        let whole = picture(&mesh);
        assert!(whole.width() > SIZE.0 as usize && whole.height() > SIZE.1 as usize);
    }
}
