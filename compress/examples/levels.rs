//! How many triangles each level of a file has: `cargo run -p hlod-compress --example levels FILE.hlod`.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;

use hlod_compress::HlodFile;

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args_os().nth(1).ok_or("name an .hlod file")?;
    let file = HlodFile::open(Path::new(&file))?;
    let mut levels: BTreeMap<u8, u64> = BTreeMap::new();
    for node in file.read_skeleton()? {
        let triangles = node.representations.first().map_or(0, |r| r.triangles);
        *levels.entry(node.cell.depth()).or_default() += u64::from(triangles);
    }
    for (depth, triangles) in levels {
        println!("depth {depth}: {triangles} triangles");
    }
    Ok(())
}
