//! Small scans in every format that is read, and what is put into them on purpose.

/// A mesh of a few triangles.
#[derive(Debug, Clone)]
pub struct Sample {
    /// Places of its vertices.
    pub positions: Vec<[f32; 3]>,
    /// Its triangles; of no meaning in STL if they name no vertex.
    pub triangles: Vec<[u32; 3]>,
}

/// A way to write it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleFormat {
    /// PLY as text.
    PlyAscii,
    /// PLY, least significant byte first.
    PlyLittle,
    /// PLY, most significant byte first.
    PlyBig,
    /// Wavefront OBJ.
    Obj,
    /// STL as text.
    StlAscii,
    /// Binary STL.
    StlBinary,
    /// glTF whose buffer is in its text.
    Gltf,
    /// Binary glTF.
    Glb,
}

impl SampleFormat {
    /// All of them.
    pub const ALL: [SampleFormat; 8] = [
        SampleFormat::PlyAscii,
        SampleFormat::PlyLittle,
        SampleFormat::PlyBig,
        SampleFormat::Obj,
        SampleFormat::StlAscii,
        SampleFormat::StlBinary,
        SampleFormat::Gltf,
        SampleFormat::Glb,
    ];

    /// What names of such files end with.
    pub fn extension(self) -> &'static str {
        match self {
            SampleFormat::PlyAscii | SampleFormat::PlyLittle | SampleFormat::PlyBig => "ply",
            SampleFormat::Obj => "obj",
            SampleFormat::StlAscii | SampleFormat::StlBinary => "stl",
            SampleFormat::Gltf => "gltf",
            SampleFormat::Glb => "glb",
        }
    }

    /// Whether triangles name vertices by numbers.
    pub fn has_indices(self) -> bool {
        !matches!(self, SampleFormat::StlAscii | SampleFormat::StlBinary)
    }
}

impl Sample {
    /// A tetrahedron, facing outwards.
    pub fn tetrahedron() -> Sample {
        Sample {
            positions: vec![[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]],
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        }
    }

    /// The bytes of a file that holds it.
    pub fn file(&self, format: SampleFormat) -> Vec<u8> {
        match format {
            SampleFormat::PlyAscii => self.ply_ascii(),
            SampleFormat::PlyLittle => {
                self.ply_binary("little", f32::to_le_bytes, u32::to_le_bytes)
            }
            SampleFormat::PlyBig => self.ply_binary("big", f32::to_be_bytes, u32::to_be_bytes),
            SampleFormat::Obj => self.obj(),
            SampleFormat::StlAscii => self.stl_ascii(),
            SampleFormat::StlBinary => self.stl_binary(),
            SampleFormat::Gltf => {
                let uri =
                    format!("data:application/octet-stream;base64,{}", base64(&self.buffer()));
                self.gltf(&format!(r#", "uri": "{uri}""#)).into_bytes()
            }
            SampleFormat::Glb => glb(&self.gltf(""), &self.buffer()),
        }
    }

    fn ply_header(&self, encoding: &str) -> String {
        format!(
            "ply\nformat {encoding} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
            self.positions.len(),
            self.triangles.len()
        )
    }

    fn ply_ascii(&self) -> Vec<u8> {
        let mut out = self.ply_header("ascii");
        self.positions.iter().for_each(|[x, y, z]| out += &format!("{x} {y} {z}\n"));
        self.triangles.iter().for_each(|[a, b, c]| out += &format!("3 {a} {b} {c}\n"));
        out.into_bytes()
    }

    fn ply_binary(
        &self,
        endian: &str,
        of_f32: fn(f32) -> [u8; 4],
        of_u32: fn(u32) -> [u8; 4],
    ) -> Vec<u8> {
        let mut out = self.ply_header(&format!("binary_{endian}_endian")).into_bytes();
        out.extend(self.positions.as_flattened().iter().flat_map(|&c| of_f32(c)));
        for triangle in &self.triangles {
            out.push(3);
            out.extend(triangle.iter().flat_map(|&corner| of_u32(corner)));
        }
        out
    }

    fn obj(&self) -> Vec<u8> {
        let mut out = String::new();
        self.positions.iter().for_each(|[x, y, z]| out += &format!("v {x} {y} {z}\n"));
        let line = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|corner| u64::from(corner) + 1);
            format!("f {a} {b} {c}\n")
        };
        out.extend(self.triangles.iter().map(line));
        out.into_bytes()
    }

    fn corners(&self) -> impl Iterator<Item = [[f32; 3]; 3]> + '_ {
        let place = |corner: u32| self.positions.get(corner as usize).copied().unwrap_or_default();
        self.triangles.iter().map(move |t| t.map(place))
    }

    fn stl_ascii(&self) -> Vec<u8> {
        let mut out = "solid sample\n".to_owned();
        for corners in self.corners() {
            out += "facet normal 0 0 0\nouter loop\n";
            corners.iter().for_each(|[x, y, z]| out += &format!("vertex {x} {y} {z}\n"));
            out += "endloop\nendfacet\n";
        }
        (out + "endsolid sample\n").into_bytes()
    }

    fn stl_binary(&self) -> Vec<u8> {
        let mut out = vec![b' '; 80];
        out.extend((self.triangles.len() as u32).to_le_bytes());
        for corners in self.corners() {
            out.extend([0; 12]);
            out.extend(corners.as_flattened().iter().flat_map(|c| c.to_le_bytes()));
            out.extend([0; 2]);
        }
        out
    }

    /// Positions, then indices.
    fn buffer(&self) -> Vec<u8> {
        let positions = self.positions.as_flattened().iter().flat_map(|c| c.to_le_bytes());
        let indices = self.triangles.as_flattened().iter().flat_map(|i| i.to_le_bytes());
        positions.chain(indices).collect()
    }

    fn gltf(&self, uri: &str) -> String {
        let (positions, indices) = (12 * self.positions.len(), 12 * self.triangles.len());
        format!(
            r#"{{"asset": {{"version": "2.0"}}, "buffers": [{{"byteLength": {}{uri}}}],
"scene": 0, "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0}}],
"meshes": [{{"primitives": [{{"indices": 1, "attributes": {{"POSITION": 0}}}}]}}],
"bufferViews": [{{"buffer": 0, "byteLength": {positions}}},
 {{"buffer": 0, "byteOffset": {positions}, "byteLength": {indices}}}],
"accessors": [{{"bufferView": 0, "componentType": 5126, "count": {}, "type": "VEC3"}},
 {{"bufferView": 1, "componentType": 5125, "count": {}, "type": "SCALAR"}}]}}"#,
            positions + indices,
            self.positions.len(),
            3 * self.triangles.len()
        )
    }
}

/// A binary glTF file of a text and a buffer.
pub fn glb(text: &str, buffer: &[u8]) -> Vec<u8> {
    let padded = format!("{text}{}", " ".repeat(text.len().next_multiple_of(4) - text.len()));
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend(((12 + 8 + padded.len() + 8 + buffer.len()) as u32).to_le_bytes());
    out.extend((padded.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(padded.as_bytes());
    out.extend((buffer.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(buffer);
    out
}

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    let digits = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for group in bytes.chunks(3) {
        let mut bits = [0; 4];
        bits[1..=group.len()].copy_from_slice(group);
        let bits = u32::from_be_bytes(bits);
        for place in 0..4 {
            let digit = digits[(bits >> (18 - 6 * place)) as usize & 63];
            text.push(if place <= group.len() { char::from(digit) } else { '=' });
        }
    }
    text
}
