//! The same work on many things, on several threads; results in the order of the things, whichever thread did them.

use std::sync::atomic::{AtomicUsize, Ordering};

use crate::{failure::Failure, report::table::progress};

/// `work` on every one of `things`, counted as `unit` on the progress bar.
///
/// # Errors
/// The first failure in the order of the things; things after a failure may be left out.
pub fn map<T: Sync, R: Send>(
    threads: usize,
    unit: &str,
    things: &[T],
    work: impl Fn(&T) -> Result<R, Failure> + Sync,
) -> Result<Vec<R>, Failure> {
    let progress = progress(things.len() as u64, unit);
    // Every thread takes the next one that nobody has taken. The counter orders nothing else: results come by join.
    let next = AtomicUsize::new(0);
    let worker = || {
        let mut done = Vec::new();
        while let Some((index, thing)) = {
            let index = next.fetch_add(1, Ordering::Relaxed);
            things.get(index).map(|thing| (index, thing))
        } {
            let result = work(thing);
            if result.is_err() {
                next.store(things.len(), Ordering::Relaxed);
            }
            done.push((index, result));
            progress.inc(1);
        }
        done
    };
    let mut done = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads.max(1)).map(|_| scope.spawn(worker)).collect();
        let joined = workers.into_iter().map(|worker| match worker.join() {
            Ok(done) => done,
            Err(panic) => std::panic::resume_unwind(panic),
        });
        joined.flatten().collect::<Vec<_>>()
    });
    progress.finish_and_clear();
    done.sort_by_key(|(index, _)| *index);
    done.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_the_order_of_the_things_on_any_number_of_threads() {
        let things: Vec<usize> = (0..100).collect();
        for threads in [0, 1, 2, 7] {
            let squares = map(threads, "", &things, |thing| Ok(thing * thing)).unwrap();
            assert!(squares.iter().enumerate().all(|(i, square)| i * i == *square) && squares.len() == 100);
        }
    }

    #[test]
    fn a_failure_ends_it() {
        let things: Vec<usize> = (0..100).collect();
        let fail = |thing: &usize| if *thing == 3 { Err(Failure::Run("three".to_owned())) } else { Ok(()) };
        assert_eq!(map(2, "", &things, fail).unwrap_err().to_string(), "three");
    }
}
