//! Where a scan stands: a matrix from its own coordinates into those of the model.

use std::fmt;
use std::path::Path;

use glam::{DMat3, DMat4, DVec3, DVec4, Vec3};
use serde::{Deserialize, Serialize};

use crate::error::{Place, ScanError, Spot};
use crate::input::Input;
use crate::report::Station;
use crate::{Batch, unit_normal_or_zero};

/// Longest text of a matrix, in bytes.
const TEXT_BYTES_MAX: u64 = 64 * 1024;

/// The last row may differ from 0 0 0 1 by so much, which is what writing it rounds.
const ROW_TOLERANCE: f64 = 1e-9;

/// Volume of a unit cube after the matrix, over that of the box of its sides' lengths: below this,
/// space is flattened.
const FLATNESS_MIN: f64 = 1e-9;

/// An affine map from a scan's own coordinates into the model's, in f64: four rows of four numbers,
/// the last of which is 0 0 0 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Transform {
    /// Row by row.
    rows: [[f64; 4]; 4],
}

impl Transform {
    /// A matrix given row by row.
    ///
    /// # Errors
    /// Says in words why it places no scan: numbers that are not finite, a last row other than
    /// 0 0 0 1, or a matrix that flattens space.
    pub fn from_rows(rows: [[f64; 4]; 4]) -> Result<Transform, String> {
        if rows.iter().flatten().any(|x| !x.is_finite()) {
            return Err("has a number that is not finite".into());
        }
        let last = DVec4::from_array(rows[3]) - DVec4::W;
        if last.abs().max_element() > ROW_TOLERANCE {
            return Err(
                "is a perspective, or written column by column: its last row is not 0 0 0 1".into(),
            );
        }
        let transform = Transform { rows };
        let linear = transform.linear();
        let lengths = [linear.x_axis, linear.y_axis, linear.z_axis].map(|axis| axis.length());
        // Each axis by its own length: no product overflows, or underflows.
        let axes = linear.to_cols_array_2d().map(DVec3::from_array);
        let [x, y, z] = [0, 1, 2].map(|i| axes[i] / lengths[i]);
        let volume = x.cross(y).dot(z).abs();
        // NaN where an axis has no length.
        if volume.is_nan() || volume <= FLATNESS_MIN {
            return Err("is singular: it flattens space".into());
        }
        Ok(transform)
    }

    /// The matrix in a text of 16 numbers, row by row, as MeshLab and CloudCompare write them.
    ///
    /// # Errors
    /// As [`Transform::from_rows`], and if these are not 16 numbers.
    pub fn parse(text: &str) -> Result<Transform, String> {
        let words = text.split(|c: char| c.is_whitespace() || c == ',' || c == ';');
        let mut numbers = Vec::with_capacity(16);
        for word in words.filter(|word| !word.is_empty()) {
            match word.parse::<f64>() {
                Ok(number) if numbers.len() < 16 => numbers.push(number),
                Ok(_) => return Err("has more than 16 numbers".into()),
                Err(_) => return Err(format!("has `{word}` where one of 16 numbers should be")),
            }
        }
        if numbers.len() < 16 {
            return Err(format!("has {} numbers instead of 16", numbers.len()));
        }
        let row = |i: usize| std::array::from_fn(|k| numbers[4 * i + k]);
        Transform::from_rows(std::array::from_fn(row))
    }

    /// Reads such a text from a file.
    ///
    /// # Errors
    /// If it cannot be read, is no text of 16 numbers, or the matrix places no scan.
    pub fn read(path: &Path) -> Result<Transform, ScanError> {
        let at = || Spot::new(path, Place::File);
        let text = read_text(path, TEXT_BYTES_MAX)?;
        Transform::parse(&text)
            .map_err(|what| ScanError::malformed(at(), format!("the matrix {what}")))
    }

    /// The rows.
    pub fn rows(&self) -> [[f64; 4]; 4] {
        self.rows
    }

    /// Whether it turns space inside out, so that orientations of triangles are turned round.
    pub fn is_mirroring(&self) -> bool {
        let linear = self.linear();
        linear.x_axis.normalize().cross(linear.y_axis.normalize()).dot(linear.z_axis) < 0.0
    }

    fn linear(&self) -> DMat3 {
        DMat3::from_mat4(self.matrix())
    }

    fn matrix(&self) -> DMat4 {
        DMat4::from_cols_array_2d(&self.rows).transpose()
    }
}

impl fmt::Display for Transform {
    /// Its rows, separated by semicolons.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, [a, b, c, d]) in self.rows.iter().enumerate() {
            write!(f, "{}{a} {b} {c} {d}", if i > 0 { "; " } else { "" })?;
        }
        Ok(())
    }
}

/// The text of a small file.
pub(crate) fn read_text(path: &Path, bytes_max: u64) -> Result<String, ScanError> {
    let at = || Spot::new(path, Place::File);
    let mut input = Input::open(path)?;
    let bytes = input.file_bytes();
    if bytes > bytes_max {
        let what = format!("{bytes} bytes are too many for such a file (at most {bytes_max})");
        return Err(ScanError::malformed(at(), what));
    }
    let mut text = Vec::new();
    loop {
        let peeked = input.peek(1)?;
        let count = peeked.len();
        text.extend_from_slice(peeked);
        input.consume(count);
        // It may grow meanwhile.
        if count == 0 || text.len() as u64 > bytes_max {
            break;
        }
    }
    String::from_utf8(text).map_err(|_| ScanError::malformed(at(), "is no text"))
}

/// Moves batches of one scan.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mover {
    matrix: DMat4,
    normals: DMat3,
    is_mirroring: bool,
    vertices: u64,
}

impl Mover {
    pub(crate) fn new(transform: &Transform) -> Mover {
        let matrix = transform.matrix();
        Mover {
            matrix,
            normals: normal_matrix(transform.linear()),
            is_mirroring: transform.is_mirroring(),
            vertices: 0,
        }
    }

    pub(crate) fn move_station(&self, station: &mut Station) {
        if let Some(position) = &mut station.position {
            *position = self.matrix.transform_point3(DVec3::from_array(*position)).to_array();
        }
    }

    pub(crate) fn apply(&mut self, batch: &mut Batch, path: &Path) -> Result<(), ScanError> {
        match batch {
            Batch::Vertices(batch) => {
                for position in &mut batch.positions {
                    *position = self.matrix.transform_point3(*position);
                    if !position.is_finite() {
                        let at = Spot::new(path, Place::File);
                        return Err(ScanError::NotFinite { at, vertex: self.vertices });
                    }
                    self.vertices += 1;
                }
                for normal in batch.normals.iter_mut().filter(|n| **n != Vec3::ZERO) {
                    *normal = unit_normal_or_zero(self.normals * normal.as_dvec3());
                }
            }
            Batch::Triangles(batch) if self.is_mirroring => {
                batch.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
            }
            Batch::Triangles(_) => {}
        }
        Ok(())
    }
}

/// Inverse transpose, up to a positive factor: normals are made unit length anyway,
/// and the cofactors exist even where the inverse does not.
pub(crate) fn normal_matrix(m: DMat3) -> DMat3 {
    // Scaled so that no product overflows or underflows.
    let scale = m.to_cols_array().into_iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    let m = if scale > 0.0 { m * (1.0 / scale) } else { m };
    let cofactors = DMat3::from_cols(
        m.y_axis.cross(m.z_axis),
        m.z_axis.cross(m.x_axis),
        m.x_axis.cross(m.y_axis),
    );
    cofactors * if m.determinant() < 0.0 { -1.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrices_are_read_row_by_row() {
        let text = "1 0 0 10\n0 0 -1 20\n0 1 0 30\n0 0 0 1\n";
        let transform = Transform::parse(text).unwrap();
        let moved = transform.matrix().transform_point3(DVec3::new(1.0, 2.0, 3.0));
        assert_eq!(moved, DVec3::new(11.0, 17.0, 32.0));
        assert!(!transform.is_mirroring());
        assert_eq!(Transform::parse(&text.replace(' ', ",")).unwrap(), transform);
        assert!(Transform::parse("-1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1").unwrap().is_mirroring());
        // Very small and very large ones are no flatter for it.
        for scale in ["1e-120", "1e120"] {
            let text = format!("{scale} 0 0 0 0 {scale} 0 0 0 0 {scale} 0 0 0 0 1");
            Transform::parse(&text).unwrap();
        }
    }

    #[test]
    fn what_places_no_scan_is_refused_by_name() {
        for (text, said) in [
            ("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0", "15 numbers"),
            ("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 7", "more than 16"),
            ("1 0 0 x 0 1 0 0 0 0 1 0 0 0 0 1", "`x`"),
            ("1 0 0 nan 0 1 0 0 0 0 1 0 0 0 0 1", "not finite"),
            ("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0.5 1", "perspective"),
            ("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 2", "perspective"),
            ("1 0 0 0 0 1 0 0 0 0 1 0 5 6 7 1", "column by column"),
            ("1 0 0 0 0 1 0 0 1 1 0 0 0 0 0 1", "singular"),
            ("0 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", "singular"),
            ("", "0 numbers"),
        ] {
            let error = Transform::parse(text).unwrap_err();
            assert!(error.contains(said), "{text}: {error}");
        }
    }

    #[test]
    fn normals_stay_across_their_surfaces() {
        // Sheared, stretched and mirrored.
        let text = "2 0.5 0 1 0 -3 0.2 2 0.1 0 1 3 0 0 0 1";
        let transform = Transform::parse(text).unwrap();
        assert!(transform.is_mirroring());
        let [a, b] = [DVec3::new(1.0, 2.0, -0.5), DVec3::new(0.3, -1.0, 2.0)];
        let normal = normal_matrix(transform.linear()) * a.cross(b);
        let [a, b] = [a, b].map(|side| transform.linear() * side);
        assert!(normal.normalize().dot(a).abs() < 1e-12 && normal.normalize().dot(b).abs() < 1e-12);
        // On the side where they were: a mirrored surface turned round.
        assert!(normal.dot(b.cross(a)) > 0.0);
    }
}
