//! What a run leaves behind for its error estimate: written by the run, read by a companion that may be on another thread.

use crate::event::Occurrence;
use phipsi_model::State;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Ends of steps and what happened, as they come; the samples when the run has ended. Readers wait for what is not there yet, so what
/// they see does not depend on when they look.
///
/// ```
/// use phipsi_motion::Trail;
/// let trail = Trail::default();
/// std::thread::scope(|scope| {
///     let third = scope.spawn(|| trail.step(2));
///     trail.advance(&[0.1, 0.2], &[]);
///     trail.advance(&[0.3], &[]);
///     assert_eq!(third.join().unwrap(), Some(0.3));
/// });
/// trail.end(Vec::new());
/// assert_eq!(trail.step(3), None);
/// ```
#[derive(Debug, Default)]
pub struct Trail {
    left: Mutex<Left>,
    news: Condvar,
    cancelled: AtomicBool,
}

#[derive(Debug, Default)]
struct Left {
    steps: Vec<f64>,
    events: Vec<Occurrence>,
    samples: Vec<State>,
    ended: bool,
}

/// How long a reader sleeps before it looks again: at first, and at most. It looks by itself, for to wake it would cost the writer
/// some microseconds each time.
const LOOK: [Duration; 2] = [Duration::from_micros(20), Duration::from_millis(5)];

impl Trail {
    /// Of a run that has ended: ends of all steps, what happened, samples.
    pub fn of_ended(steps: &[f64], events: &[Occurrence], samples: &[State]) -> Self {
        let (steps, events, samples) = (steps.to_vec(), events.to_vec(), samples.to_vec());
        Trail { left: Mutex::new(Left { steps, events, samples, ended: true }), ..Trail::default() }
    }
    /// Adds ends of accepted steps and all that happened up to the last of them.
    pub fn advance(&self, steps: &[f64], events: &[Occurrence]) {
        let mut left = self.lock();
        left.steps.extend_from_slice(steps);
        left.events.extend_from_slice(events);
    }
    /// The run has ended; its states at the instants at which it is judged.
    pub fn end(&self, samples: Vec<State>) {
        let mut left = self.lock();
        (left.samples, left.ended) = (samples, true);
        drop(left);
        self.news.notify_all();
    }
    /// Nobody wants the estimate any more: readers find the run ended where it is.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
        self.lock().ended = true;
        self.news.notify_all();
    }
    /// True once it is cancelled.
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
    /// End of the k-th accepted step, counted from 0; `None` if the run has ended before.
    pub fn step(&self, k: usize) -> Option<f64> {
        self.wait_for(|left| left.steps.len() > k).steps.get(k).copied()
    }
    /// Completes a copy of what happened up to time t.
    pub(crate) fn follow_events(&self, t: f64, copy: &mut Vec<Occurrence>) {
        // At t itself something may still happen.
        let left = self.wait_for(|left| left.steps.last().is_some_and(|last| *last > t));
        copy.extend(left.events.iter().skip(copy.len()).take_while(|o| o.t <= t));
    }
    /// The samples, when the run has ended.
    pub(crate) fn samples(&self) -> Vec<State> {
        let goes_on = |left: &mut Left| !left.ended;
        self.news.wait_while(self.lock(), goes_on).unwrap_or_else(PoisonError::into_inner).samples.clone()
    }

    // A writer that panicked has left whole entries.
    fn lock(&self) -> MutexGuard<'_, Left> {
        self.left.lock().unwrap_or_else(PoisonError::into_inner)
    }
    fn wait_for(&self, is_there: impl Fn(&Left) -> bool) -> MutexGuard<'_, Left> {
        let (mut left, mut patience) = (self.lock(), LOOK[0]);
        while !left.ended && !is_there(&left) {
            left = self.news.wait_timeout(left, patience).unwrap_or_else(PoisonError::into_inner).0;
            patience = LOOK[1].min(2 * patience);
        }
        left
    }
}
