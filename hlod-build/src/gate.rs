//! Keeps what is in memory at a time within a budget.

use std::sync::{Condvar, Mutex};

/// Lets work in as long as what it needs fits beside what is in already.
pub(crate) struct Gate {
    budget_bytes: u64,
    inside_bytes: Mutex<u64>,
    left: Condvar,
}

/// Leaves when dropped.
pub(crate) struct Admitted<'a> {
    gate: &'a Gate,
    bytes: u64,
}

/// More than the budget.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TooMuch {
    pub(crate) needed_bytes: u64,
    pub(crate) budget_bytes: u64,
}

impl Gate {
    pub(crate) fn new(budget_bytes: u64) -> Gate {
        Gate { budget_bytes, inside_bytes: Mutex::new(0), left: Condvar::new() }
    }

    /// Waits until there is room.
    ///
    /// # Errors
    /// When more is needed than the whole budget.
    pub(crate) fn enter(&self, bytes: u64) -> Result<Admitted<'_>, TooMuch> {
        if bytes > self.budget_bytes {
            return Err(TooMuch { needed_bytes: bytes, budget_bytes: self.budget_bytes });
        }
        let mut inside = self.inside_bytes.lock().unwrap_or_else(|e| e.into_inner());
        while *inside + bytes > self.budget_bytes {
            inside = self.left.wait(inside).unwrap_or_else(|e| e.into_inner());
        }
        *inside += bytes;
        Ok(Admitted { gate: self, bytes })
    }
}

impl Drop for Admitted<'_> {
    fn drop(&mut self) {
        let mut inside = self.gate.inside_bytes.lock().unwrap_or_else(|e| e.into_inner());
        *inside -= self.bytes;
        self.gate.left.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    #[test]
    fn what_is_inside_never_exceeds_the_budget() {
        let gate = Gate::new(100);
        let inside = AtomicU64::new(0);
        std::thread::scope(|scope| {
            for i in 0..8u64 {
                let (gate, inside) = (&gate, &inside);
                scope.spawn(move || {
                    for k in 0..200 {
                        let bytes = 10 + (i * 31 + k * 17) % 90;
                        let admitted = gate.enter(bytes).expect("it fits");
                        let now = inside.fetch_add(bytes, Ordering::SeqCst) + bytes;
                        assert!(now <= 100, "{now}");
                        inside.fetch_sub(bytes, Ordering::SeqCst);
                        drop(admitted);
                    }
                });
            }
        });
        let too_much = TooMuch { needed_bytes: 101, budget_bytes: 100 };
        assert_eq!(gate.enter(101).err(), Some(too_much));
    }
}
