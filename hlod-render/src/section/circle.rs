//! The circle that lines fit best.
//!
//! Lines are integrated, not their points counted: a densely scanned stretch weighs no more than
//! a sparse one of the same length. Three points of each segment stand for it, with Simpson's weights.
//! First the algebraic fit of Taubin, *Estimation of planar curves, surfaces, and nonplanar space
//! curves defined by implicit equations* (1991), by the Newton iteration of Chernov, *Circular and
//! linear regression* (2010), section 5.10; from there Gauss–Newton on the distances themselves, since
//! algebraic fits of short arcs are biased.

use glam::{DMat3, DVec2, DVec3};

/// A fitted circle, lengths in the source's unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Its centre, in the frame that points were given in.
    pub centre: DVec2,
    /// Its radius.
    pub radius: f64,
    /// Root of the mean square of the lines' distances from it.
    pub rms: f64,
    /// The farthest that any point of the lines' corners is from it.
    pub largest: f64,
}

/// Why there is no circle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NoCircle {
    /// Two points or fewer.
    #[error("fewer than three different points")]
    TooFew,
    /// On a line, or so nearly that the radius would be a guess.
    #[error("the points lie on a line")]
    Straight,
}

/// Steps of either iteration. Both are quadratic near the end; what has not settled is a line.
const STEPS: usize = 100;
/// A change that no longer counts, as a share of the radius.
const SETTLED: f64 = 1e-13;
/// Points whose variance across is less than this share of that along lie on a line: arcs of a
/// sagitta below a millionth of their length.
const STRAIGHT: f64 = 1e-12;
/// Circles larger than this many times the points' spread are lines, too.
const RADIUS_MAX: f64 = 1e5;

impl Circle {
    /// Fits a circle to segments.
    ///
    /// # Errors
    /// When they have fewer than three different points, or lie on a line.
    pub fn fit(segments: impl Iterator<Item = [DVec2; 2]> + Clone) -> Result<Circle, NoCircle> {
        let samples = Samples::of(segments)?;
        let start = samples.algebraic()?;
        let (centre, radius) = samples.geometric(start)?;
        let residual = |p: DVec2| (p.distance(centre) - radius).abs();
        let rms = samples.mean(|p| residual(p).powi(2)).sqrt();
        let largest = samples.points.iter().map(|(p, _)| residual(*p)).fold(0.0, f64::max);
        let scale = samples.scale;
        Ok(Circle {
            centre: samples.middle + centre * scale,
            radius: radius * scale,
            rms: rms * scale,
            largest: largest * scale,
        })
    }
}

/// Points with weights that add up to 1, moved to their mean and scaled to a spread of 1.
struct Samples {
    points: Vec<(DVec2, f64)>,
    middle: DVec2,
    scale: f64,
}

impl Samples {
    fn of(segments: impl Iterator<Item = [DVec2; 2]> + Clone) -> Result<Samples, NoCircle> {
        let length: f64 = segments.clone().map(|[a, b]| a.distance(b)).sum();
        let known = length > 0.0 && length.is_finite();
        if !known || !has_three_points(segments.clone()) {
            return Err(NoCircle::TooFew);
        }
        let mut points = Vec::new();
        for [a, b] in segments {
            let weight = a.distance(b) / length;
            let simpson = [(a, 1.0), (a.midpoint(b), 4.0), (b, 1.0)];
            points.extend(simpson.map(|(p, share)| (p, share / 6.0 * weight)));
        }
        let mut samples = Samples { points, middle: DVec2::ZERO, scale: 1.0 };
        // A first mean near the points, for precision far from the origin.
        let first = samples.points[0].0;
        let middle = first + samples.mean_point(|p| p - first);
        let scale = samples.mean(|p| p.distance_squared(middle)).sqrt();
        samples.points.iter_mut().for_each(|(p, _)| *p = (*p - middle) / scale);
        (samples.middle, samples.scale) = (middle, scale);
        Ok(samples)
    }

    fn mean(&self, value: impl Fn(DVec2) -> f64) -> f64 {
        self.points.iter().map(|(p, weight)| weight * value(*p)).sum()
    }

    fn mean_point(&self, value: impl Fn(DVec2) -> DVec2) -> DVec2 {
        self.points.iter().map(|(p, weight)| value(*p) * *weight).sum()
    }

    /// Taubin's fit: the smallest root of a cubic by Newton's method from 0, where it is monotonous.
    fn algebraic(&self) -> Result<(DVec2, f64), NoCircle> {
        let moment = |i: i32, j: i32, k: i32| {
            self.mean(|p| p.x.powi(i) * p.y.powi(j) * p.length_squared().powi(k))
        };
        let (xx, yy, xy) = (moment(2, 0, 0), moment(0, 2, 0), moment(1, 1, 0));
        let (xz, yz, zz) = (moment(1, 0, 1), moment(0, 1, 1), moment(0, 0, 2));
        let z = xx + yy;
        let covariance = xx * yy - xy * xy;
        if covariance <= STRAIGHT * z * z {
            return Err(NoCircle::Straight);
        }
        let variance = zz - z * z;
        let a3 = 4.0 * z;
        let a2 = -3.0 * z * z - zz;
        let a1 = variance * z + 4.0 * covariance * z - xz * xz - yz * yz;
        let a0 = xz * (xz * yy - yz * xy) + yz * (yz * xx - xz * xy) - variance * covariance;
        let mut root = 0.0;
        for _ in 0..STEPS {
            let value = a0 + root * (a1 + root * (a2 + root * a3));
            let slope = a1 + root * (2.0 * a2 + root * 3.0 * a3);
            let next = root - value / slope;
            if !next.is_finite() || next < root || next - root <= SETTLED {
                break;
            }
            root = next;
        }
        let determinant = root * root - root * z + covariance;
        let centre = DVec2::new(xz * (yy - root) - yz * xy, yz * (xx - root) - xz * xy)
            / (2.0 * determinant);
        let radius = (centre.length_squared() + z).sqrt();
        if radius.is_nan() || radius > RADIUS_MAX {
            return Err(NoCircle::Straight);
        }
        Ok((centre, radius))
    }

    /// Gauss–Newton on distances, with steps that are halved as long as they make things worse.
    fn geometric(&self, start: (DVec2, f64)) -> Result<(DVec2, f64), NoCircle> {
        let cost = |c: DVec2, r: f64| self.mean(|p| (p.distance(c) - r).powi(2));
        let (mut centre, mut radius) = start;
        let mut best = cost(centre, radius);
        for _ in 0..STEPS {
            let mut step = self.gauss_newton_step(centre, radius);
            let mut better = None;
            while step.length() > SETTLED * radius {
                let (c, r) = (centre + DVec2::new(step.x, step.y), radius + step.z);
                let new = cost(c, r);
                if new < best && r > 0.0 {
                    better = Some((c, r, new));
                    break;
                }
                step *= 0.5;
            }
            let Some(next) = better else { break };
            (centre, radius, best) = next;
        }
        if radius.is_nan() || radius > RADIUS_MAX || !centre.is_finite() {
            return Err(NoCircle::Straight);
        }
        Ok((centre, radius))
    }

    /// Change of centre (x, y) and radius (z) that would be best if distances were linear.
    fn gauss_newton_step(&self, centre: DVec2, radius: f64) -> DVec3 {
        let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for (p, weight) in &self.points {
            let towards = (centre - *p).normalize_or_zero();
            let gradient = DVec3::new(towards.x, towards.y, -1.0);
            let residual = p.distance(centre) - radius;
            right -= gradient * (residual * weight);
            let outer = DMat3::from_cols(
                gradient * gradient.x,
                gradient * gradient.y,
                gradient * gradient.z,
            );
            normal += outer * *weight;
        }
        let step = normal.inverse() * right;
        if step.is_finite() { step } else { DVec3::ZERO }
    }
}

fn has_three_points(segments: impl Iterator<Item = [DVec2; 2]>) -> bool {
    let mut known: Vec<DVec2> = Vec::new();
    for p in segments.flatten() {
        if !known.contains(&p) {
            known.push(p);
        }
        if known.len() == 3 {
            return true;
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arc(centre: DVec2, radius: f64, from: f64, to: f64, n: usize) -> Vec<DVec2> {
        (0..=n)
            .map(|i| from + (to - from) * i as f64 / n as f64)
            .map(|angle| centre + DVec2::from_angle(angle) * radius)
            .collect()
    }

    fn fit(points: &[DVec2]) -> Result<Circle, NoCircle> {
        Circle::fit(points.windows(2).map(|pair| [pair[0], pair[1]]))
    }

    #[test]
    fn circles_and_arcs_are_found_also_far_away() {
        for centre in [DVec2::ZERO, DVec2::new(4e5, -5e6)] {
            for turn in [6.2, 1.0, 0.1] {
                let circle = fit(&arc(centre, 3.0, 0.4, 0.4 + turn, 2000)).unwrap();
                // Chords lie inside the circle, by less than their sagitta.
                assert!((circle.radius - 3.0).abs() < 1e-4, "{turn}: {circle:?}");
                assert!(circle.centre.distance(centre) < 1e-4, "{turn}: {circle:?}");
                assert!(circle.rms <= circle.largest && circle.largest < 1e-5);
            }
        }
    }

    #[test]
    fn a_densely_scanned_side_weighs_no_more() {
        // An ellipse, half of it with a hundred times the points.
        let ellipse = |from: f64, n| arc(DVec2::ZERO, 1.0, from, from + std::f64::consts::PI, n);
        let mut points = ellipse(0.0, 20_000);
        points.extend(ellipse(std::f64::consts::PI, 200));
        points.iter_mut().for_each(|p| p.x *= 1.2);
        let circle = fit(&points).unwrap();
        assert!(circle.centre.length() < 1e-4, "{circle:?}");
        assert!((circle.rms - 0.07).abs() < 0.01 && circle.largest > 0.09, "{circle:?}");
    }

    #[test]
    fn the_geometric_fit_is_a_minimum_of_the_distances() {
        let mut points = arc(DVec2::new(1.0, 2.0), 5.0, 0.0, 0.8, 400);
        for (i, p) in points.iter_mut().enumerate() {
            *p *= 1.0 + 0.002 * (i as f64 * 2.4).sin();
        }
        let circle = fit(&points).unwrap();
        let samples = Samples::of(points.windows(2).map(|pair| [pair[0], pair[1]])).unwrap();
        let cost = |c: DVec2, r: f64| {
            let mean =
                samples.mean(|p| ((samples.middle + p * samples.scale).distance(c) - r).powi(2));
            mean.sqrt()
        };
        assert!((cost(circle.centre, circle.radius) - circle.rms).abs() < 1e-12);
        for d in [DVec2::X, DVec2::Y, -DVec2::X, -DVec2::Y] {
            assert!(cost(circle.centre + d * 1e-3, circle.radius) > circle.rms);
        }
        assert!(cost(circle.centre, circle.radius + 1e-3) > circle.rms);
    }

    #[test]
    fn lines_and_points_are_refused_with_a_reason() {
        let line: Vec<DVec2> = (0..50).map(|i| DVec2::new(1.0, 2.0) * f64::from(i)).collect();
        assert_eq!(fit(&line), Err(NoCircle::Straight));
        assert_eq!(fit(&line[..2]), Err(NoCircle::TooFew));
        assert_eq!(fit(&[]), Err(NoCircle::TooFew));
        let there_and_back = [line[0], line[1], line[0]];
        assert_eq!(fit(&there_and_back), Err(NoCircle::TooFew));
        // Hardly bent is a circle still; a millionth of a radian is not.
        assert!(fit(&arc(DVec2::ZERO, 1.0, 0.0, 1e-2, 50)).is_ok());
        assert_eq!(fit(&arc(DVec2::ZERO, 1.0, 0.0, 1e-6, 50)), Err(NoCircle::Straight));
    }
}
