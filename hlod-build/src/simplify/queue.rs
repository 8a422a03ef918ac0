//! A priority queue of edges whose order is exact to an eighth of an octave.
//!
//! Buckets instead of a heap: an edge is queued and taken in constant time, and collapses that
//! differ by less than a bucket's width are as good as one another.

/// Eight buckets an octave: the upper bits of a positive `f32` count them.
const SHIFT: u32 = f32::MANTISSA_DIGITS - 1 - 3;

#[derive(Debug, Default)]
pub(super) struct BucketQueue {
    buckets: Vec<Vec<[u32; 2]>>,
    /// No bucket below this holds anything.
    lowest: usize,
}

impl BucketQueue {
    /// Which bucket a cost belongs to; costs are not negative.
    pub(super) fn bucket_of(cost: f64) -> usize {
        ((cost as f32).max(0.0).to_bits() >> SHIFT) as usize
    }

    pub(super) fn push(&mut self, bucket: usize, edge: [u32; 2]) {
        if bucket >= self.buckets.len() {
            self.buckets.resize_with(bucket + 1, Vec::new);
        }
        self.buckets[bucket].push(edge);
        self.lowest = self.lowest.min(bucket);
    }

    /// An edge of the lowest bucket, and that bucket.
    pub(super) fn pop(&mut self) -> Option<(usize, [u32; 2])> {
        while let Some(bucket) = self.buckets.get_mut(self.lowest) {
            if let Some(edge) = bucket.pop() {
                return Some((self.lowest, edge));
            }
            self.lowest += 1;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_come_out_in_the_order_of_their_costs() {
        let costs = [3.0, 0.0, 1e-20, 7e9, 1.0, 0.2];
        let mut queue = BucketQueue::default();
        for (i, &cost) in costs.iter().enumerate() {
            queue.push(BucketQueue::bucket_of(cost), [i as u32, 0]);
        }
        let order: Vec<u32> = std::iter::from_fn(|| queue.pop()).map(|(_, e)| e[0]).collect();
        assert_eq!(order, [1, 2, 5, 4, 0, 3]);
        // An octave has eight buckets.
        assert_eq!(BucketQueue::bucket_of(2.0) - BucketQueue::bucket_of(1.0), 8);
        queue.push(BucketQueue::bucket_of(0.5), [9, 9]);
        assert_eq!(queue.pop().map(|(_, e)| e), Some([9, 9]));
    }
}
