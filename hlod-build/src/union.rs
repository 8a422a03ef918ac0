//! Sets of things that belong together (union–find, path halving).

/// Disjoint sets of numbers from 0.
pub(crate) struct Union {
    parent: Vec<u32>,
}

impl Union {
    /// Every number by itself.
    pub(crate) fn new(count: usize) -> Union {
        Union { parent: (0..count as u32).collect() }
    }

    /// The number that stands for the set of `v`: its smallest.
    pub(crate) fn root(&mut self, mut v: u32) -> u32 {
        while self.parent[v as usize] != v {
            self.parent[v as usize] = self.parent[self.parent[v as usize] as usize];
            v = self.parent[v as usize];
        }
        v
    }

    pub(crate) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}
