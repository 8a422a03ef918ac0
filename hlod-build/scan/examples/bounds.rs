//! Where a scan lies: `cargo run -p hlod-scan --example bounds SCAN`.

use std::error::Error;
use std::path::Path;

use hlod_scan::{Batch, ScanReader};

fn main() -> Result<(), Box<dyn Error>> {
    let scan = std::env::args_os().nth(1).ok_or("name a scan")?;
    let mut reader = ScanReader::open(Path::new(&scan))?;
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    while let Some(batch) = reader.next_batch()? {
        let Batch::Vertices(batch) = batch else { continue };
        for position in &batch.positions {
            for (axis, place) in position.to_array().into_iter().enumerate() {
                low[axis] = low[axis].min(place);
                high[axis] = high[axis].max(place);
            }
        }
    }
    println!("{}: from {low:?} to {high:?}", reader.header().format);
    Ok(())
}
