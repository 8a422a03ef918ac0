//! Builds a file from a scan: `cargo run -p hlod-build --example build SCAN FILE.hlod`.

use std::error::Error;
use std::path::PathBuf;

use hlod_build::progress::Silent;
use hlod_build::{BuildOptions, build};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(scan), Some(output)) = (arguments.next(), arguments.next()) else {
        return Err("name a scan and the file to write".into());
    };
    let report = build(&[scan], &output, &BuildOptions::default(), &Silent)?;
    println!("{} triangles, {} nodes", report.triangles_input, report.nodes);
    Ok(())
}
