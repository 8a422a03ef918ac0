//! Any bytes are a mesh or an error; a mesh can be coded again and comes back as it was.
#![no_main]

use hlod_compress::{decode_mesh, encode_mesh};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(mesh) = decode_mesh(bytes)
        && let Ok(page) = encode_mesh(&mesh, 0)
    {
        let again = decode_mesh(&page).expect("what was encoded can be decoded");
        assert_eq!(again.triangles.len(), mesh.triangles.len());
        assert_eq!(again.bounds(), mesh.bounds());
    }
});
