//! What the timers share: one line per question on standard input, one line per answer on standard output.
//!
//! Question: `MODEL OPERATION STATES-FILE REPETITIONS`, for the others of `validation/speed` too.
//! Answer: `NS CHECKSUM` for REPETITIONS > 0: CPU time per state (of the thread; of a batch: of all threads), and the sum of the
//! last call's results;
//! `result X X …` for REPETITIONS ≤ 0: the results at state −REPETITIONS; `unsupported`; or `error: REASON`.
//! States: `COUNT NQ NV`, then q, v, tau, a of each state; calls cycle through them.

use cpu_time::{ProcessTime, ThreadTime};
use std::io::{BufRead, Write};

/// Why something failed.
pub type Failure = Box<dyn std::error::Error>;

/// States of a model, one after another.
#[derive(Default)]
pub struct States {
    pub count: usize,
    nq: usize,
    nv: usize,
    rows: [Vec<f64>; 4],
}

impl States {
    /// From the text of a file.
    fn read(text: &str) -> Result<Self, Failure> {
        let mut words = text.split_ascii_whitespace();
        let mut header =
            || words.next().ok_or("the states lack their header")?.parse().map_err(Failure::from);
        let (count, nq, nv): (usize, usize, usize) = (header()?, header()?, header()?);
        let mut rows: [Vec<f64>; 4] = Default::default();
        for _ in 0..count {
            for (row, n) in rows.iter_mut().zip([nq, nv, nv, nv]) {
                for _ in 0..n {
                    row.push(words.next().ok_or("the states end early")?.parse()?);
                }
            }
        }
        Ok(States { count, nq, nv, rows })
    }
    /// States made in the program itself.
    #[allow(dead_code)] // one of the programs that share this file uses it
    pub fn new(count: usize, nq: usize, nv: usize, rows: [Vec<f64>; 4]) -> Self {
        States { count, nq, nv, rows }
    }
    /// (nq, nv).
    pub fn dimensions(&self) -> (usize, usize) {
        (self.nq, self.nv)
    }
    pub fn q(&self, i: usize) -> &[f64] {
        &self.rows[0][i * self.nq..][..self.nq]
    }
    pub fn v(&self, i: usize) -> &[f64] {
        &self.rows[1][i * self.nv..][..self.nv]
    }
    pub fn tau(&self, i: usize) -> &[f64] {
        &self.rows[2][i * self.nv..][..self.nv]
    }
    pub fn a(&self, i: usize) -> &[f64] {
        &self.rows[3][i * self.nv..][..self.nv]
    }
    /// All states' q, v, tau, a, state by state.
    #[allow(dead_code)] // one of the programs that share this file uses it
    pub fn all(&self) -> &[Vec<f64>; 4] {
        &self.rows
    }
}

/// One call at a state; results into the buffer, matrices by rows.
pub type Call<'a> = Box<dyn FnMut(usize, &mut [f64]) -> Result<(), Failure> + 'a>;

/// An algorithm on the open model.
pub struct Operation<'a> {
    /// Results per state.
    pub size: usize,
    /// Computes all states in one call, whatever its argument; results state by state.
    pub batch: bool,
    pub call: Call<'a>,
}

/// What each program provides.
pub trait Program: Sized {
    /// Opens a model.
    fn open(model: &str) -> Result<Self, Failure>;
    /// States that the program makes itself, by a name that is no file.
    fn states(&self, _name: &str) -> Option<States> {
        None
    }
    /// The algorithm of a name, if there is one.
    fn operation<'a>(&'a self, name: &str, states: &'a States) -> Result<Option<Operation<'a>>, Failure>;
}

fn answer(operation: Operation<'_>, states: &States, repetitions: i64) -> Result<String, Failure> {
    let Operation { size, batch, mut call } = operation;
    let per_call = if batch { states.count } else { 1 };
    let mut out = vec![0.0; size * per_call];
    if repetitions <= 0 {
        let state = repetitions.unsigned_abs() as usize % states.count;
        call(state, &mut out)?;
        let result = &out[if batch { state * size } else { 0 }..][..size];
        let words: Vec<String> = result.iter().map(|x| format!(" {x:e}")).collect();
        return Ok(format!("result{}", words.concat()));
    }
    let calls = (repetitions as usize).div_ceil(per_call);
    let mut state = 0;
    let begun = (ThreadTime::try_now()?, ProcessTime::try_now()?);
    for _ in 0..calls {
        call(state, &mut out)?;
        state = if state + 1 == states.count { 0 } else { state + 1 };
    }
    // A batch may run on several threads: what all of them took together.
    let time = if batch { begun.1.try_elapsed()? } else { begun.0.try_elapsed()? };
    let ns = time.as_nanos() as f64 / (calls * per_call) as f64;
    Ok(format!("{ns} {:e}", out.iter().sum::<f64>()))
}

/// What stays open between questions.
pub struct Session<P> {
    name: String,
    program: P,
    states_name: String,
    states: States,
}

/// The answer to one question.
pub fn reply<P: Program>(open: &mut Option<Session<P>>, line: &str) -> Result<String, Failure> {
    let words: Vec<&str> = line.split_ascii_whitespace().collect();
    let [model, operation, states, repetitions] = words[..] else {
        return Err("four words are required".into());
    };
    let repetitions: i64 = repetitions.parse()?;
    if open.as_ref().is_none_or(|o| o.name != model) {
        let program = P::open(model)?;
        *open = Some(Session {
            name: model.into(),
            program,
            states_name: String::new(),
            states: States::default(),
        });
    }
    let Some(open) = open else { return Err("no model is open".into()) };
    if open.states_name != states {
        open.states = match open.program.states(states) {
            Some(states) => states,
            None => States::read(&std::fs::read_to_string(states)?)?,
        };
        open.states_name = states.into();
    }
    if open.states.count == 0 {
        return Err("there are no states".into());
    }
    match open.program.operation(operation, &open.states)? {
        Some(operation) => answer(operation, &open.states, repetitions),
        None => Ok("unsupported".into()),
    }
}

/// Answers until standard input ends.
pub fn serve<P: Program>() -> Result<(), Failure> {
    let mut open = None;
    for line in std::io::stdin().lock().lines() {
        let answer = reply::<P>(&mut open, &line?).unwrap_or_else(|reason| format!("error: {reason}"));
        // One line, whatever an error's text holds.
        println!("{}", answer.replace('\n', " "));
        std::io::stdout().flush()?;
    }
    Ok(())
}
