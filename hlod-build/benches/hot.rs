//! The hot loops of a build: `cargo bench -p hlod-build --features bench`. What whole builds cost is in
//! `bench-paths/RESULTS.md`.

use divan::Bencher;
use divan::counter::ItemsCount;
use hlod_build::hot::Node;

/// Squares of a sheet's side: nodes have some 16 thousand triangles, or four times as many before they are simplified.
const SIDES: [u32; 2] = [90, 180];

fn main() {
    divan::main();
}

/// Counts triangles of the source.
fn bench<T>(bencher: Bencher<'_, '_>, side: u32, work: impl Fn(&Node) -> T + Sync) {
    let node = Node::waves(side);
    bencher.counter(ItemsCount::new(node.triangles())).bench(|| work(&node));
}

/// Both representations of a node: collapse, certify, take back.
#[divan::bench(args = SIDES)]
fn simplify(bencher: Bencher<'_, '_>, side: u32) {
    bench(bencher, side, Node::simplify);
}

/// One certificate from scratch.
#[divan::bench(args = SIDES)]
fn certify(bencher: Bencher<'_, '_>, side: u32) {
    bench(bencher, side, Node::certify);
}

/// Through the middle, where the octree divides.
#[divan::bench(args = SIDES)]
fn cut(bencher: Bencher<'_, '_>, side: u32) {
    bench(bencher, side, Node::cut);
}
