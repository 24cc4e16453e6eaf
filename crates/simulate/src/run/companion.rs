//! The companion run of an error estimate on a thread of its own, beside the run.
//!
//! It begins with the run, follows it through a [`Trail`], and is thrown away where the run did not end as planned (an event ended it): then
//! the estimate is made after the run. What it says does not depend on when it runs.

use super::cores::{Busy, CORES, processors};
use super::estimate::{Estimated, JUDGED_SAMPLES, Watched, in_words};
use crate::record::{Observer, spread};
use crate::simulation::Simulation;
use phipsi_model::{Model, State};
use phipsi_motion::{ErrorEstimate, Method, Occurrence, PlannedRun, Trail, estimate_error_beside};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

/// Wall time between two messages to the companion, each of which takes a lock.
const NEWS: Duration = Duration::from_micros(50);

/// Wall time between two looks whether the user wants to stop.
const PATIENCE: Duration = Duration::from_millis(20);

/// A companion run that goes on.
pub(super) struct Companion {
    trail: Arc<Trail>,
    thread: Option<JoinHandle<()>>,
    _busy: Busy<'static>,
    result: Receiver<Estimated>,
    /// Where the run should end, and the times of the samples that it should record.
    end: f64,
    instants: Vec<f64>,
    /// Not told yet.
    steps: Vec<f64>,
    events: Vec<Occurrence>,
    told: Instant,
    last: Option<f64>,
}

impl Companion {
    /// Begins, with the steps and events of a run that is resumed; `None` where it cannot: where no processor is free, or with a force
    /// that has no second one.
    ///
    /// Runs and companions of this process are counted, the run itself included: many runs at once keep all processors busy by
    /// themselves. Where a number of threads is asked for, that is what counts.
    pub(super) fn begin(
        simulation: &Simulation,
        method: Method,
        breaks: &[f64],
        steps: &[f64],
        events: &[Occurrence],
    ) -> Option<Self> {
        let busy = match simulation.threads {
            Some(threads) if threads.min(processors()) < 2 => return None,
            Some(_) => CORES.occupy(),
            None => CORES.occupy_free(processors())?,
        };
        let mut dynamics = simulation.dynamics.another()?;
        dynamics.pass_over_stops(true);
        let count = usize::try_from(simulation.samples()).ok()?;
        let instants: Vec<f64> =
            spread(count, JUDGED_SAMPLES).map(|k| simulation.sample_time(k as u64)).collect();
        let trail = Arc::new(Trail::default());
        trail.advance(steps, events);
        let (sender, result) = channel();
        let (theirs, at, breaks, end) = (trail.clone(), instants.clone(), breaks.to_vec(), simulation.t_end);
        let (State { q, v, t }, tolerances) = (simulation.start.clone(), simulation.tolerances);
        let work = move || {
            let aux = vec![0.0; phipsi_motion::System::auxiliary_len(&dynamics)];
            let start = (t, &q[..], &v[..], &aux[..]);
            let planned = PlannedRun { method, tolerances, start, end, breaks: &breaks, instants: &at };
            let mut watched = Watched { dynamics: &mut dynamics, stop: &|| theirs.is_cancelled() };
            // Nobody listens any more where the run has failed.
            let _ = sender.send(estimate_error_beside(&mut watched, &planned, &theirs));
        };
        let thread = Builder::new().name("error estimate".into()).spawn(work).ok()?;
        Some(Companion {
            trail,
            thread: Some(thread),
            _busy: busy,
            result,
            end,
            instants,
            steps: Vec::new(),
            events: Vec::new(),
            told: Instant::now(),
            last: steps.last().copied(),
        })
    }
    /// Takes an accepted step, and what happened in it.
    pub(super) fn step(&mut self, t: f64, happened: &[Occurrence]) {
        self.steps.push(t);
        self.events.extend_from_slice(happened);
        self.last = Some(t);
        if self.told.elapsed() >= NEWS {
            self.tell();
        }
    }
    fn tell(&mut self) {
        self.trail.advance(&self.steps, &self.events);
        self.steps.clear();
        self.events.clear();
        self.told = Instant::now();
    }
    /// True if the run that has ended is the one that was planned.
    pub(super) fn fits(&self, samples: &[State]) -> bool {
        let times = samples.iter().map(|s| s.t);
        self.last == Some(self.end) && times.eq(self.instants.iter().copied())
    }
    /// The estimate, of a run that has ended as planned; `None` if the user wants to stop.
    pub(super) fn finish(
        mut self,
        samples: Vec<State>,
        model: &Model,
        observer: &mut dyn Observer,
    ) -> Option<ErrorEstimate> {
        self.tell();
        self.trail.end(samples);
        loop {
            match self.result.recv_timeout(PATIENCE) {
                Ok(estimated) => return in_words(estimated, model, observer),
                Err(RecvTimeoutError::Timeout) if observer.stop() => return None,
                Err(RecvTimeoutError::Timeout) => {}
                // It panicked, and so does the run.
                Err(RecvTimeoutError::Disconnected) => {
                    if let Some(Err(panic)) = self.thread.take().map(JoinHandle::join) {
                        std::panic::resume_unwind(panic);
                    }
                    return None;
                }
            }
        }
    }
}

/// It stops before its next evaluation.
impl Drop for Companion {
    fn drop(&mut self) {
        self.trail.cancel();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
