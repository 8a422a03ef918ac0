//! Any bytes are a page or an error; what a page holds can be coded again and comes back as it was.
#![no_main]

use hlod_compress::{decode_page, encode_page};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(content) = decode_page(bytes)
        && let Ok(page) = encode_page(&content, 0, 0)
    {
        let again = decode_page(&page).expect("what was encoded can be decoded");
        assert_eq!(again.mesh.triangles.len(), content.mesh.triangles.len());
        assert_eq!(again.mesh.bounds(), content.mesh.bounds());
        assert_eq!(again.points.len(), content.points.len());
        assert_eq!(again.points.bounds(), content.points.bounds());
    }
});
