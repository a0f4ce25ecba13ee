//! One function applied to many items on several threads. The results have the order of the items.

use std::sync::atomic::{AtomicUsize, Ordering};

use crate::{failure::Failure, report::table::progress};

/// Applies `work` to each of `items`. The progress bar counts them as `unit`.
///
/// # Errors
/// The first failure in the order of the items. Items after a failure may be left out.
pub fn map<T: Sync, R: Send>(
    threads: usize,
    unit: &str,
    items: &[T],
    work: impl Fn(&T) -> Result<R, Failure> + Sync,
) -> Result<Vec<R>, Failure> {
    let progress = progress(items.len() as u64, unit);
    // Every thread takes the next item that no thread has taken. The counter orders nothing else: join gives the
    // results.
    let next = AtomicUsize::new(0);
    let worker = || {
        let mut done = Vec::new();
        while let Some((index, item)) = {
            let index = next.fetch_add(1, Ordering::Relaxed);
            items.get(index).map(|item| (index, item))
        } {
            let result = work(item);
            if result.is_err() {
                next.store(items.len(), Ordering::Relaxed);
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
    fn results_have_the_order_of_the_items_on_any_number_of_threads() {
        let items: Vec<usize> = (0..100).collect();
        for threads in [0, 1, 2, 7] {
            let squares = map(threads, "", &items, |item| Ok(item * item)).unwrap();
            assert!(squares.iter().enumerate().all(|(i, square)| i * i == *square) && squares.len() == 100);
        }
    }

    #[test]
    fn a_failure_ends_it() {
        let items: Vec<usize> = (0..100).collect();
        let fail = |item: &usize| if *item == 3 { Err(Failure::run("three")) } else { Ok(()) };
        assert_eq!(map(2, "", &items, fail).unwrap_err().to_string(), "three");
    }
}
