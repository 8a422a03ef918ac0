//! The passes and how long their sources are: `cargo run -p hlod-shaders --example passes`.

fn main() {
    for pass in hlod_shaders::ALL {
        println!("{:10} {} lines", pass.name, pass.source.lines().count());
    }
}
