//! Where a ray along -z first meets the scan: `cargo run -p hlod-render --example nearest FILE.hlod`.

use std::error::Error;
use std::path::Path;

use glam::DVec3;
use hlod_render::leaves::Leaves;
use hlod_render::pick::first_hit;

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args_os().nth(1).ok_or("name an .hlod file")?;
    let leaves = Leaves::open(Path::new(&file))?;
    match first_hit(&leaves, DVec3::Z * 1e6, -DVec3::Z)? {
        Some(hit) => println!("{}", hit.position),
        None => println!("it misses"),
    }
    Ok(())
}
