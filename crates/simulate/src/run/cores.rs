//! Which processors runs and companions of this process keep busy.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A count of what runs at present.
#[derive(Debug, Default)]
pub(super) struct Cores(AtomicUsize);

/// One that is counted, until it is dropped.
#[derive(Debug)]
pub(super) struct Busy<'a>(&'a Cores);

/// Those of this process.
pub(super) static CORES: Cores = Cores(AtomicUsize::new(0));

impl Cores {
    /// Counts one more, whether there is a processor for it or not.
    pub(super) fn occupy(&self) -> Busy<'_> {
        self.0.fetch_add(1, Ordering::Relaxed);
        Busy(self)
    }
    /// Counts one more if that leaves no more than `all`.
    pub(super) fn occupy_free(&self, all: usize) -> Option<Busy<'_>> {
        let more = |busy: usize| (busy < all).then_some(busy + 1);
        self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, more).ok().map(|_| Busy(self))
    }
}

impl Drop for Busy<'_> {
    fn drop(&mut self) {
        self.0.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Processors that this process may use; the system is asked once, it looks the answer up in files.
pub(super) fn processors() -> usize {
    static PROCESSORS: OnceLock<usize> = OnceLock::new();
    *PROCESSORS.get_or_init(|| std::thread::available_parallelism().map_or(1, |n| n.get()))
}

#[cfg(test)]
mod tests {
    use super::Cores;

    /// Four processors: three runs leave room for one companion, five for none, and what has ended makes room again.
    #[test]
    fn companions_take_what_is_free_and_give_it_back() {
        let cores = Cores::default();
        let runs: Vec<_> = (0..3).map(|_| cores.occupy()).collect();
        let companion = cores.occupy_free(4);
        assert!(companion.is_some() && cores.occupy_free(4).is_none());
        drop(companion);
        let further = [cores.occupy(), cores.occupy()];
        assert!(cores.occupy_free(4).is_none());
        drop(further);
        assert!(cores.occupy_free(4).is_some());
        drop(runs);
        // Eight at once for three of four processors.
        let run = cores.occupy();
        let taken: Vec<_> = std::thread::scope(|scope| {
            let tries: Vec<_> = (0..8).map(|_| scope.spawn(|| cores.occupy_free(4))).collect();
            tries.into_iter().filter_map(|t| t.join().unwrap()).collect()
        });
        assert_eq!(taken.len(), 3);
        drop((run, taken));
        assert_eq!(cores.0.into_inner(), 0);
    }
}
