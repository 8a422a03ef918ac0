//! How the light sees the scene: see `shadow.wgsl` for the space.

use glam::{DMat4, DVec2, DVec3, DVec4};

use crate::scene::Light;

/// One picture as the light sees it. Lengths are world units; positions are relative to the scene's
/// centre, which the caller chooses.
#[derive(Debug, Clone)]
pub(crate) struct Face {
    pub(crate) light_from_world: DMat4,
    /// What is nearer to the light along its axis is not drawn.
    pub(crate) near: f64,
    /// Largest tangent of what belongs to this face; 0 where there is only one.
    pub(crate) limit: f64,
    /// Unit vectors across the picture and away from the light.
    axes: [DVec3; 3],
    /// A point light's position.
    light: Option<DVec3>,
}

/// Faces of a cube overlap by this much, so that rounding loses no point between them.
const CUBE_LIMIT: f64 = 1.0001;

/// One face where the light sees all of `receivers` in a cone, six round a light that they surround.
/// Positions are relative to the scene's centre, `right` is the camera's.
pub(crate) fn faces(light: Light, right: DVec3, receivers: &[DVec3]) -> Vec<Face> {
    let perpendicular = |axis: DVec3| {
        let u = right - axis * right.dot(axis);
        u.try_normalize().unwrap_or_else(|| axis.any_orthonormal_vector())
    };
    match light {
        Light::Directional(towards) => {
            let away = -towards.normalize_or(DVec3::Y);
            let u = perpendicular(away);
            vec![Face::new(u, away, None, 0.0, 0.0)]
        }
        Light::Point(light) => {
            let reach = receivers.iter().map(|p| p.distance(light)).fold(0.0, f64::max);
            let near = 1e-5 * reach;
            let middle = receivers.iter().sum::<DVec3>() / receivers.len().max(1) as f64;
            let axis = (middle - light).normalize_or(DVec3::Y);
            let in_cone = |p: &DVec3| axis.dot(*p - light) > 0.3 * p.distance(light);
            if receivers.iter().all(in_cone) {
                return vec![Face::new(perpendicular(axis), axis, Some(light), near, 0.0)];
            }
            [DVec3::X, DVec3::Y, DVec3::Z]
                .into_iter()
                .flat_map(|axis| [axis, -axis])
                .map(|axis| {
                    let u = axis.any_orthonormal_vector();
                    Face::new(u, axis, Some(light), near, CUBE_LIMIT)
                })
                .collect()
        }
    }
}

impl Face {
    fn new(u: DVec3, away: DVec3, light: Option<DVec3>, near: f64, limit: f64) -> Face {
        // Right-handed with the third axis towards the light: what faces it turns to the left.
        let v = u.cross(away);
        let row = |n: DVec3| n.extend(-n.dot(light.unwrap_or(DVec3::ZERO)));
        let (depth, w) = match light {
            None => (away.extend(0.0), DVec4::W),
            Some(_) => (-DVec4::W, row(away)),
        };
        let rows = DMat4::from_cols(row(u), row(v), depth, w);
        Face { light_from_world: rows.transpose(), near, limit, axes: [u, v, away], light }
    }

    /// A point of light space (x / w, y / w, z / w) in the world, the way from there to a point of the
    /// light, and how many times that leads there. `on_light` is across its picture: in world units,
    /// or of parallel light tangents.
    pub(crate) fn world(&self, [x, y, depth]: [f64; 3], on_light: DVec2) -> (DVec3, DVec3, f64) {
        let [u, v, away] = self.axes;
        let offset = u * on_light.x + v * on_light.y;
        match self.light {
            None => (u * x + v * y + away * depth, offset - away, f64::INFINITY),
            Some(light) => {
                let point = (u * x + v * y + away) / -depth;
                (light + point, offset - point, 1.0)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_come_back_from_light_space() {
        let receivers = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(-1.0, 0.5, 0.0)];
        let far = Light::Point(DVec3::new(0.0, 40.0, 3.0));
        let amid = Light::Point(DVec3::new(0.1, 1.0, 1.4));
        for light in [Light::Directional(DVec3::new(0.3, 1.0, -0.2)), far, amid] {
            let faces = faces(light, DVec3::X, &receivers);
            assert_eq!(faces.len(), if light == amid { 6 } else { 1 });
            for point in receivers {
                let mut found = 0;
                for face in &faces {
                    let p = face.light_from_world * point.extend(1.0);
                    let inside = p.x.abs().max(p.y.abs()) <= face.limit * p.w;
                    if p.w <= 0.0 || face.limit > 0.0 && !inside {
                        continue;
                    }
                    found += 1;
                    let place = [p.x / p.w, p.y / p.w, p.z / p.w];
                    let (back, to_light, _) = face.world(place, DVec2::ZERO);
                    assert!(back.distance(point) < 1e-12, "{light:?} {back}");
                    match light {
                        Light::Point(l) => assert!((back + to_light).distance(l) < 1e-12),
                        Light::Directional(d) => {
                            assert!(to_light.distance(d.normalize()) < 1e-12);
                        }
                    }
                }
                assert_eq!(found, 1, "{light:?}");
            }
        }
    }

    #[test]
    fn depth_grows_away_from_the_light_and_fronts_turn_left() {
        for light in [Light::Directional(DVec3::Y), Light::Point(DVec3::new(0.0, 5.0, 0.0))] {
            let corners = [DVec3::ZERO, DVec3::Z, DVec3::X];
            let face = &faces(light, DVec3::X, &corners)[0];
            let place = |p: DVec3| face.light_from_world * p.extend(1.0);
            let depth = |p: DVec3| place(p).z / place(p).w;
            assert!(depth(DVec3::NEG_Y) > depth(DVec3::ZERO));
            // Seen from above, z → x is against the clock: its front is up.
            let [a, b, c] = corners.map(|p| {
                let p = place(p);
                DVec3::new(p.x, p.y, p.w)
            });
            assert!(a.dot(b.cross(c)) > 0.0, "{light:?}");
        }
    }
}
