//! Two sides of a step that go on at the same time.

use std::sync::mpsc::sync_channel;
use std::thread;

use crate::error::BuildError;

/// What may wait between the two sides.
const WAITING: usize = 1;

/// Hands what `produce` emits to `consume`, in order, while the next is being produced; with one
/// thread allowed, in turn. The first error ends both sides.
pub(crate) fn overlap<T: Send, R: Send>(
    produce: impl FnOnce(&mut dyn FnMut(T) -> Result<(), BuildError>) -> Result<R, BuildError> + Send,
    mut consume: impl FnMut(T) -> Result<(), BuildError>,
) -> Result<R, BuildError> {
    if rayon::current_num_threads() == 1 {
        return produce(&mut consume);
    }
    let (sender, receiver) = sync_channel(WAITING);
    thread::scope(|scope| {
        let producer = scope.spawn(move || {
            // Sending fails only when the consumer has failed, whose error is the one that is told.
            let gone = |_| BuildError::Usage("what was read is not taken any more".into());
            produce(&mut |item| sender.send(item).map_err(gone))
        });
        let mut consumed = Ok(());
        for item in receiver {
            consumed = consume(item);
            if consumed.is_err() {
                break;
            }
        }
        let produced = producer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        consumed.and(produced)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_come_in_order_and_errors_of_either_side_are_told() {
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let run = |producer_fails: bool, consumer_fails_at: u32| {
                let mut seen = Vec::new();
                let result = overlap(
                    |emit| {
                        (0..100).try_for_each(&mut *emit)?;
                        if producer_fails { Err(BuildError::Usage("p".into())) } else { Ok(7) }
                    },
                    |item: u32| {
                        seen.push(item);
                        if item == consumer_fails_at {
                            return Err(BuildError::Usage("c".into()));
                        }
                        Ok(())
                    },
                );
                (result.map_err(|error| error.to_string()), seen)
            };
            let all: Vec<u32> = (0..100).collect();
            pool.install(|| {
                assert_eq!(run(false, 1000), (Ok(7), all.clone()));
                assert_eq!(run(true, 1000), (Err("p".into()), all.clone()));
                assert_eq!(run(false, 5), (Err("c".into()), all[..6].to_vec()));
            });
        }
    }
}
