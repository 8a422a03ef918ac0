//! The points of sections as a table with commas.

use super::sheet::Sheet;

impl Sheet {
    /// One row a point: layer, number of the line, whether it is closed, number of the point, source
    /// coordinates and coordinates in the plane's frame. The columns' names carry the unit, where it
    /// is known. RFC 4180; numbers have every digit that they need to be read back the same.
    pub fn to_csv(&self) -> Vec<u8> {
        let unit = self.unit_suffix().replace(' ', "_");
        let mut text = String::from("section,line,closed,point");
        for name in ["x", "y", "z", "u", "v"] {
            text += &format!(",{name}{unit}");
        }
        text += "\r\n";
        for layer in &self.layers {
            for (i, line) in layer.section.lines.iter().enumerate() {
                for (j, p) in line.points.iter().enumerate() {
                    let q = layer.section.frame.to_plane(*p);
                    let (name, closed) = (&layer.name, line.closed);
                    let (i, j) = (i + 1, j + 1);
                    text += &format!(
                        "{name},{i},{closed},{j},{},{},{},{},{}\r\n",
                        p.x, p.y, p.z, q.x, q.y
                    );
                }
            }
        }
        text.into_bytes()
    }
}
