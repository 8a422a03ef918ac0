//! How a statue stands: its own right, up and front, as someone who works on it says, when the scanner's axes are not
//! those; and how long its lengths are, where a known one shows that the scan's are not.
//!
//! Both are declarations. They change no coordinate of the session and nothing of the file; what is shown in the
//! statue's frame or corrected is labelled so.

use glam::{DMat3, DVec3};
use hlod_compress::Unit;
use serde::{Deserialize, Serialize};

use crate::figure::scale::millimetres;
use crate::measure::{Measured, MeasurementKind, SurfacePoint};

/// A statue's own coordinates: x to its right, y upwards, z to its front, in the source's unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectFrame {
    /// Source coordinates (x, y, z, 1) to the statue's: three rows of a rigid matrix.
    pub object_from_source: [[f64; 4]; 3],
    /// How it was found, in words.
    pub made: String,
    /// Whether coordinates are shown in it.
    #[serde(default)]
    pub shown: bool,
}

/// Axes that are off by more are no rigid matrix.
const RIGID: f64 = 1e-6;
/// Points of which none is farther than this share of their extent from a line have no plane.
const FLAT: f64 = 1e-4;

impl ObjectFrame {
    /// With its origin at a place of the scan. `up` and `front` are unit vectors at right angles.
    fn new(up: DVec3, front: DVec3, origin: DVec3, made: String) -> ObjectFrame {
        let row = |axis: DVec3| [axis.x, axis.y, axis.z, -axis.dot(origin)];
        let object_from_source = [row(up.cross(front)), row(up), row(front)];
        ObjectFrame { object_from_source, made, shown: true }
    }

    /// Of axes of the scan, with its origin; `front` is made perpendicular to `up`.
    ///
    /// # Errors
    /// When both are along the same line.
    pub fn of_axes(up: DVec3, front: DVec3) -> Result<ObjectFrame, String> {
        let name = |v: DVec3| {
            let axes = [("x", DVec3::X), ("y", DVec3::Y), ("z", DVec3::Z)];
            let found = axes.iter().find(|(_, axis)| v.dot(*axis).abs() > 1.0 - 1e-9);
            found.map_or("other".to_owned(), |(name, axis)| {
                let sign = if v.dot(*axis) < 0.0 { "−" } else { "" };
                format!("{sign}{name}")
            })
        };
        let upwards = up.try_normalize().ok_or("up has no direction")?;
        let front = square_to(front, upwards).ok_or("up and front are along the same line")?;
        let made = format!("up {}, front {}", name(upwards), name(front));
        Ok(ObjectFrame::new(upwards, front, DVec3::ZERO, made))
    }

    /// The first point is the origin, the second is above it, and the third is to its front.
    ///
    /// # Errors
    /// When they are on one line.
    pub fn through(points: [DVec3; 3]) -> Result<ObjectFrame, String> {
        let [origin, above, ahead] = points;
        let up = (above - origin).try_normalize().ok_or("the first two points are the same")?;
        let front = square_to(ahead - origin, up).filter(|_| {
            let off = (ahead - origin).reject_from(up).length();
            off > FLAT * above.distance(origin)
        });
        let front = front.ok_or("the three points are on one line")?;
        Ok(ObjectFrame::new(up, front, origin, "through three points".into()))
    }

    /// On a plane through points, of which the statue's middle is above; the front stays as near as it can to what
    /// it was.
    ///
    /// # Errors
    /// When the points have no plane.
    pub fn standing_on(
        points: &[DVec3],
        middle: DVec3,
        before: [DVec3; 3],
    ) -> Result<ObjectFrame, String> {
        let (normal, at, off) = fitted_plane(points)?;
        let up = if (middle - at).dot(normal) < 0.0 { -normal } else { normal };
        let front = kept_direction(before[2], before[1], up);
        let made = format!(
            "standing on a plane through {} points, none farther from it than {off:.3}",
            points.len()
        );
        Ok(ObjectFrame::new(up, front, at, made))
    }

    /// With a plane through points as its front, on the side to which the surface faces; up stays as near as it can
    /// to what it was.
    ///
    /// # Errors
    /// When the points have no plane.
    pub fn facing(points: &[SurfacePoint], before: [DVec3; 3]) -> Result<ObjectFrame, String> {
        let places: Vec<DVec3> = points.iter().map(SurfacePoint::place).collect();
        let (normal, at, off) = fitted_plane(&places)?;
        let facing: DVec3 = points.iter().map(|p| DVec3::from_array(p.normal)).sum();
        let front = if facing.dot(normal) < 0.0 { -normal } else { normal };
        let up = kept_direction(before[1], -before[2], front);
        let made = format!(
            "facing from a plane through {} points, none farther from it than {off:.3}",
            points.len()
        );
        Ok(ObjectFrame::new(up, front, at, made))
    }

    /// Unit vectors right, up and front in source coordinates.
    pub fn axes(&self) -> [DVec3; 3] {
        self.object_from_source.map(|[x, y, z, _]| DVec3::new(x, y, z))
    }

    /// A place of the scan in the statue's coordinates.
    pub fn place(&self, source: [f64; 3]) -> [f64; 3] {
        let source = DVec3::from_array(source);
        self.object_from_source.map(|[x, y, z, w]| DVec3::new(x, y, z).dot(source) + w)
    }

    /// A direction or a difference.
    pub fn vector(&self, source: [f64; 3]) -> [f64; 3] {
        self.axes().map(|axis| axis.dot(DVec3::from_array(source)))
    }

    pub(super) fn validate(&self) -> Result<(), String> {
        super::text(&self.made)?;
        if !self.object_from_source.iter().flatten().all(|v| v.is_finite() && v.abs() < 1e12) {
            return Err("`object_from_source` has what is not a number or too large".into());
        }
        let [right, up, front] = self.axes();
        let turned = DMat3::from_cols(right, up, front);
        let off = turned.transpose() * turned - DMat3::IDENTITY;
        let is_rigid = off.to_cols_array().iter().all(|v| v.abs() < RIGID);
        if !is_rigid || turned.determinant() < 0.0 {
            return Err("`object_from_source` does more than turn and move".into());
        }
        Ok(())
    }
}

/// The part of a vector at right angles to a unit vector, of length 1.
fn square_to(vector: DVec3, unit: DVec3) -> Option<DVec3> {
    let vector = vector.try_normalize()?;
    // Once more: of nearly parallel ones the first difference has few digits.
    let square = vector.reject_from_normalized(unit).try_normalize()?;
    (vector.reject_from_normalized(unit).length() > 1e-9)
        .then(|| square.reject_from_normalized(unit).normalize())
}

/// What becomes of a direction that has to be at right angles to another; where they are nearly along the same line, of
/// what is instead.
fn kept_direction(direction: DVec3, instead: DVec3, square: DVec3) -> DVec3 {
    let is_clear = direction.dot(square).abs() < 0.99;
    let kept = square_to(if is_clear { direction } else { instead }, square);
    kept.unwrap_or_else(|| square.any_orthonormal_vector())
}

/// Unit normal of the plane that lies nearest to points by least squares, their middle, and how far they are from it at
/// most.
fn fitted_plane(points: &[DVec3]) -> Result<(DVec3, DVec3, f64), String> {
    if points.len() < 3 {
        return Err(format!("a plane needs three points, not {}", points.len()));
    }
    let middle = points.iter().sum::<DVec3>() / points.len() as f64;
    let extent = points.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
    let one_line = "the points are on one line";
    if extent <= 0.0 {
        return Err("the points are all the same".into());
    }
    let mut spread = DMat3::ZERO;
    for p in points {
        let d = (*p - middle) / extent;
        spread += DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    }
    // The direction in which they spread least, by inverse iteration; what is added keeps planes invertible.
    let inverse = (spread + DMat3::from_diagonal(DVec3::splat(1e-12))).inverse();
    let steepest = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| inverse * axis);
    let mut normal = steepest[0];
    for column in steepest {
        if column.length_squared() > normal.length_squared() {
            normal = column;
        }
    }
    for _ in 0..200 {
        normal = (inverse * normal).try_normalize().ok_or(one_line)?;
    }
    // In the plane they must spread in two directions.
    let (u, v) = normal.any_orthonormal_pair();
    let [uu, uv, vv] = [(u, u), (u, v), (v, v)].map(|(a, b)| a.dot(spread * b));
    let least = 0.5 * (uu + vv - ((uu - vv).powi(2) + 4.0 * uv * uv).sqrt());
    if least < FLAT * FLAT {
        return Err(one_line.into());
    }
    let off = points.iter().map(|p| (*p - middle).dot(normal).abs()).fold(0.0, f64::max);
    Ok((normal, middle, off))
}

/// A length that is known, between two points that were picked: all lengths of the scan are to be multiplied so that
/// this one is right.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScaleCorrection {
    /// Between which points.
    pub points: [SurfacePoint; 2],
    /// How long it is, in `unit`.
    pub known_length: f64,
    /// mm, cm, m, um or in.
    pub unit: String,
    /// Who says so, and how it was measured.
    #[serde(default)]
    pub source: String,
}

/// A result after a [`ScaleCorrection`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Corrected {
    /// In the correction's unit, or its square.
    pub value: f64,
    /// How far that may be from what the scan file itself gives with the same known length, by its bound and by those
    /// of the two points; what the known length itself is off by is not in it.
    pub file_bound: Option<f64>,
}

impl ScaleCorrection {
    /// Between two points that are as far from each other as the scan says, until someone says better.
    ///
    /// # Errors
    /// When they are nearer to each other than their bounds allow.
    pub fn new(points: [SurfacePoint; 2], unit: Unit) -> Result<ScaleCorrection, String> {
        let unit = if millimetres(unit).is_some() { unit } else { Unit::Millimetre };
        let known_length = points[0].place().distance(points[1].place());
        let correction = ScaleCorrection {
            points,
            known_length,
            unit: unit.name().to_owned(),
            source: String::new(),
        };
        correction.validate()?;
        Ok(correction)
    }

    /// As the scan has it, in the source's unit.
    pub fn measured_length(&self) -> f64 {
        self.points[0].place().distance(self.points[1].place())
    }

    /// What lengths are multiplied by: from the source's unit to that of the correction.
    pub fn factor(&self) -> f64 {
        self.known_length / self.measured_length()
    }

    /// A length or an area corrected; angles and places are not.
    pub fn apply(&self, kind: MeasurementKind, measured: &Measured) -> Option<Corrected> {
        let (factor, length) = (self.factor(), self.measured_length());
        match kind {
            MeasurementKind::Point | MeasurementKind::Angle => None,
            MeasurementKind::SurfaceArea => {
                Some(Corrected { value: measured.value * factor * factor, file_bound: None })
            }
            _ => {
                // The scan's own distance may be shorter by the points' bounds, and its factor as much larger.
                let off: f64 = self.points.iter().map(|p| p.file_bound).sum();
                let largest = self.known_length / (length - off);
                let of = |bound: f64| bound * largest + measured.value * (largest - factor);
                Some(Corrected {
                    value: measured.value * factor,
                    file_bound: measured.file_bound.map(of),
                })
            }
        }
    }

    pub(super) fn validate(&self) -> Result<(), String> {
        super::text(&self.source)?;
        self.points.iter().try_for_each(SurfacePoint::validate)?;
        if !(self.known_length > 0.0 && self.known_length < 1e12) {
            return Err("`known_length` must be positive".into());
        }
        let unit: Option<Unit> = self.unit.parse().ok();
        unit.and_then(millimetres).ok_or("`unit` must be mm, cm, m, um or in")?;
        let off: f64 = self.points.iter().map(|p| p.file_bound).sum();
        if self.measured_length() <= off {
            return Err("its two points are nearer to each other than their bounds allow".into());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEFORE: [DVec3; 3] = [DVec3::X, DVec3::Y, DVec3::Z];

    fn point(position: DVec3, normal: DVec3) -> SurfacePoint {
        SurfacePoint {
            position: position.to_array(),
            normal: normal.to_array(),
            file_bound: 0.01,
            pixel_length: None,
        }
    }

    fn near(a: [f64; 3], b: [f64; 3]) -> bool {
        (0..3).all(|i| (a[i] - b[i]).abs() < 1e-9)
    }

    /// A statue that lies on its back, far from the origin.
    fn turn() -> (DMat3, DVec3) {
        let turn = DMat3::from_rotation_x(-1.3) * DMat3::from_rotation_y(0.4);
        (turn, DVec3::new(1200.0, -300.0, 80.0))
    }

    #[test]
    fn three_points_are_origin_above_and_ahead() {
        let (turn, at) = turn();
        let [right, up, front] = [turn.x_axis, turn.y_axis, turn.z_axis];
        let frame = ObjectFrame::through([at, at + 3.0 * up, at + 0.7 * front + 9.0 * up]).unwrap();
        assert!(frame.validate().is_ok());
        let found = frame.axes();
        assert!(found[0].distance(right) + found[1].distance(up) + found[2].distance(front) < 1e-9);
        let p = at + 2.0 * right - 5.0 * up + 0.5 * front;
        assert!(near(frame.place(p.to_array()), [2.0, -5.0, 0.5]));
        assert!(near(frame.vector((2.0 * front).to_array()), [0.0, 0.0, 2.0]));
        for wrong in [[at, at, at + up], [at, at + up, at + 2.0 * up], [at, at + up, at]] {
            assert!(ObjectFrame::through(wrong).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn a_statue_stands_on_a_plane_whichever_way_round_its_points_are() {
        let (turn, at) = turn();
        let [right, up, front] = [turn.x_axis, turn.y_axis, turn.z_axis];
        let middle = at + 5.0 * up + right;
        // Five points that are not quite in a plane.
        let off = [0.01, -0.01, 0.01, -0.01, 0.0];
        let around = |i: usize| {
            let angle = i as f64 * 1.2566;
            at + angle.cos() * 2.0 * right + angle.sin() * 3.0 * front + off[i] * up
        };
        let mut points: Vec<DVec3> = (0..5).map(around).collect();
        let frame = ObjectFrame::standing_on(&points, middle, [right, up, front]).unwrap();
        assert!(frame.axes()[1].dot(up) > 0.9999);
        assert!(frame.axes()[2].dot(front) > 0.9999, "the front stays");
        assert!(frame.made.contains("5 points"), "{}", frame.made);
        assert!(frame.validate().is_ok());
        points.reverse();
        let again = ObjectFrame::standing_on(&points, middle, [right, up, front]).unwrap();
        assert!(again.axes()[1].distance(frame.axes()[1]) < 1e-9);
        // Seen from the other side of the plane it stands on its head.
        let below = ObjectFrame::standing_on(&points, at - up, BEFORE).unwrap();
        assert!(below.axes()[1].dot(up) < -0.9999);
        let line: Vec<DVec3> = (0..5).map(|i| at + f64::from(i) * up).collect();
        assert!(ObjectFrame::standing_on(&line, middle, BEFORE).is_err());
        assert!(ObjectFrame::standing_on(&points[..2], middle, BEFORE).is_err());
    }

    #[test]
    fn a_relief_faces_where_its_surface_does_and_stays_upright() {
        let facing = DVec3::new(0.8, 0.1, 0.3).normalize();
        let (u, v) = facing.any_orthonormal_pair();
        let points: Vec<SurfacePoint> =
            [u, -u, v, u + v].iter().map(|p| point(*p, facing)).collect();
        let frame = ObjectFrame::facing(&points, BEFORE).unwrap();
        let [_, up, front] = frame.axes();
        assert!(front.dot(facing) > 0.999_999);
        assert!(up.dot(DVec3::Y) > 0.9);
        // Of a slab on the ground up is what was behind it, so that it is seen as from before it.
        let slab: Vec<SurfacePoint> = [DVec3::X, DVec3::Z, -DVec3::X, -DVec3::Z]
            .iter()
            .map(|p| point(*p, DVec3::Y))
            .collect();
        let frame = ObjectFrame::facing(&slab, BEFORE).unwrap();
        assert!(frame.axes()[1].distance(-DVec3::Z) < 1e-9, "{:?}", frame.axes());
    }

    #[test]
    fn axes_of_the_scan_are_named_and_must_not_be_the_same() {
        let frame = ObjectFrame::of_axes(-DVec3::Z, DVec3::Y).unwrap();
        assert_eq!(frame.made, "up −z, front y");
        assert_eq!(frame.place([1.0, 2.0, 3.0])[1], -3.0);
        assert!(ObjectFrame::of_axes(DVec3::X, -DVec3::X).is_err());
    }

    #[test]
    fn what_is_no_rigid_matrix_is_refused() {
        let good = ObjectFrame::of_axes(DVec3::Y, DVec3::Z).unwrap();
        assert!(good.validate().is_ok());
        let changed = |row: usize, column: usize, value: f64| {
            let mut frame = good.clone();
            frame.object_from_source[row][column] = value;
            frame.validate().is_err()
        };
        assert!(changed(0, 0, 1.01), "it stretches");
        assert!(changed(0, 0, -1.0), "it mirrors");
        assert!(changed(1, 0, 0.1), "it shears");
        assert!(changed(2, 3, f64::NAN));
        assert!(!changed(2, 3, 5.0), "it moves");
    }

    #[test]
    fn corrected_lengths_hold_the_bounds_of_what_they_rest_on() {
        let points = [point(DVec3::ZERO, DVec3::Y), point(100.0 * DVec3::X, DVec3::Y)];
        let mut scale = ScaleCorrection::new(points, Unit::Unknown).unwrap();
        assert_eq!((scale.factor(), scale.unit.as_str()), (1.0, "mm"));
        scale.known_length = 101.0;
        let measured = Measured { value: 50.0, file_bound: Some(0.02), delta: None };
        let corrected = scale.apply(MeasurementKind::Distance, &measured).unwrap();
        assert!((corrected.value - 50.5).abs() < 1e-12);
        // The worst case: the two points are 0.02 nearer in the scan, and the measured length 0.02 longer.
        let worst = 50.02 * 101.0 / 99.98 - 50.5;
        assert!((corrected.file_bound.unwrap() - worst).abs() < 1e-12);
        let area = scale.apply(MeasurementKind::SurfaceArea, &measured).unwrap();
        assert!((area.value - 50.0 * 1.01 * 1.01).abs() < 1e-12 && area.file_bound.is_none());
        assert!(scale.apply(MeasurementKind::Angle, &measured).is_none());
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(ScaleCorrection { known_length: wrong, ..scale.clone() }.validate().is_err());
        }
        assert!(ScaleCorrection { unit: "ell".into(), ..scale.clone() }.validate().is_err());
        let same = [points[0], points[0]];
        assert!(ScaleCorrection::new(same, Unit::Metre).is_err());
    }
}
