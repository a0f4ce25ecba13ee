//! What a page may ask of the axes, with `--allow-control`.
//!
//! | path | token | does |
//! |---|---|---|
//! | `/control/off` | not needed | stops all axes over the board; can do nothing else |
//! | `/control/hello` | needed | tells the server's time, which later requests send back as their stamp |
//! | `/control/press`, `beat`, `release` | needed | arm axes for as long as a button is held: [`super::hold`] |
//! | `/control/reset` | needed | releases latched axes, which stay disarmed |
//! | `/control/gain` | needed | changes the gains of the fallback of an axis that is off |
//!
//! All are POST with a body of JSON of the page's own origin, which the guard has checked.

use std::{
    sync::{Arc, Mutex, MutexGuard, PoisonError, atomic::AtomicBool},
    time::{Duration, Instant},
};

use axum::{
    Extension, Router,
    body::Bytes,
    http::{HeaderMap, HeaderName, StatusCode, header},
    response::{IntoResponse, Response},
    routing::post,
};
use pipeline::{
    channel::{Prefix, remove_leftovers},
    machine::TipTask,
    message::AxisMode,
};
use serde::Deserialize;
use serde_json::{Value, json};

use super::{
    hold::{Hold, LEASE, Phase, Wanted},
    published::Published,
    token::{Token, Verdict},
};
use crate::{
    arguments::axes_of,
    failure::Failure,
    group::operator::{Operator, OperatorError, board},
    teeth::{ALL, PITCHES, TeethPlace},
};

/// Header that carries the token. No form and no link of another page can send it, and the passwords of a proxy have
/// another one.
const TOKEN: HeaderName = HeaderName::from_static("x-hydraxis-token");
/// Largest command from the page: whoever holds its button may not see the machine.
const LARGEST_COMMAND: f64 = 0.3;
/// Largest speed of the teeth from the page, m/s.
const FASTEST_TEETH: f64 = 0.2;
/// Time in which a stop is to be answered.
const PATIENCE: Duration = Duration::from_secs(1);
/// Time between two looks at the board.
const LOOK: Duration = Duration::from_millis(2);

/// The control of one server.
pub struct Control {
    token: Mutex<Token>,
    hold: Mutex<Option<Arc<Hold>>>,
    published: Arc<Published>,
    /// Stamps count from here.
    begin: Instant,
}

/// An answer that is no success: its status, and why.
type Refused = (StatusCode, String);
type Answer = Result<Value, Refused>;

/// Axes, and what they are to do.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Press {
    hold: u64,
    stamp: u64,
    axes: Vec<String>,
    mode: String,
    target: Option<f64>,
    command: Option<f64>,
    teeth: Option<Teeth>,
}

/// Where the bucket's teeth are to go: m, degrees, m/s.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct Teeth {
    x: f64,
    z: f64,
    pitch: Option<f64>,
    speed: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Beat {
    hold: u64,
    stamp: u64,
    target: Option<f64>,
    command: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Release {
    hold: u64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Reset {
    axes: Vec<String>,
}

/// An axis, and the part of the gains in the machine file that its fallback is to have.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Gain {
    axis: String,
    gain: f64,
}

impl Control {
    /// With a new token.
    ///
    /// # Errors
    /// The system gives no random numbers.
    pub fn new(published: Arc<Published>) -> std::io::Result<Self> {
        let token = Mutex::new(Token::new()?);
        Ok(Self { token, hold: Mutex::new(None), published, begin: Instant::now() })
    }

    /// The token, for the person at the terminal.
    pub fn token(&self) -> String {
        self.token.lock().unwrap_or_else(PoisonError::into_inner).text().to_owned()
    }

    fn slot(&self) -> MutexGuard<'_, Option<Arc<Hold>>> {
        self.hold.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The button with this number, if it is held.
    fn held(&self, id: u64) -> Option<Arc<Hold>> {
        self.slot().clone().filter(|hold| hold.id == id)
    }

    /// Refuses a request without the token. `id`: number of the button that it is about.
    fn admit(&self, headers: &HeaderMap, id: Option<u64>) -> Result<(), Refused> {
        let said = headers.get(TOKEN).and_then(|value| value.to_str().ok());
        let operates = id.and_then(|id| self.held(id)).is_some_and(|hold| !hold.is_released());
        let mut token = self.token.lock().unwrap_or_else(PoisonError::into_inner);
        match token.judge(said, operates, Instant::now()) {
            Verdict::Right => Ok(()),
            Verdict::Wrong => Err(refused(
                StatusCode::FORBIDDEN,
                "found no token, or a wrong one; allowed: the one that the monitor has printed at its start",
            )),
            Verdict::TooMany => {
                Err(refused(StatusCode::TOO_MANY_REQUESTS, "found too many wrong tokens; allowed: again in a minute"))
            }
        }
    }

    fn group(&self) -> Result<Prefix, Refused> {
        self.published.group().clone().ok_or_else(|| refused(StatusCode::CONFLICT, "found no group that runs"))
    }

    /// The server's time, ms.
    fn stamp(&self) -> u64 {
        self.begin.elapsed().as_millis() as u64
    }

    /// The time of a stamp.
    fn time_of(&self, stamp: u64) -> Result<Instant, Refused> {
        let age = self.stamp().checked_sub(stamp).map(Duration::from_millis);
        match age.filter(|age| *age < LEASE) {
            Some(_) => Ok(self.begin + Duration::from_millis(stamp)),
            None => Err(refused(
                StatusCode::CONFLICT,
                format!("found a request that was too long on its way; allowed: {} ms", LEASE.as_millis()),
            )),
        }
    }

    fn press(&self, press: &Press) -> Answer {
        let stamp = self.time_of(press.stamp)?;
        if press.axes.is_empty() {
            return Err(unusable("axes: found none; allowed: at least one"));
        }
        let prefix = self.group()?;
        let machine = *board(&prefix).map_err(failed)?.machine();
        let axes = axes_of(machine.names(), &press.axes).map_err(|error| unusable(error.to_string()))?;
        let mode = [AxisMode::Manual, AxisMode::Hold, AxisMode::Track].into_iter().find(|m| m.name() == press.mode);
        let Some(mode) = mode else {
            return Err(unusable(format!("mode: found {:?}; allowed: manual, hold, track", press.mode)));
        };
        if press.teeth.is_some() && (press.target.is_some() || press.command.is_some()) {
            return Err(unusable("teeth: found together with target or command; allowed: without"));
        }
        let teeth = press.teeth.map(|teeth| place_of(teeth, mode, &axes)).transpose()?;
        let wanted = Wanted { mode, target: press.target, command: press.command.unwrap_or_default(), teeth };
        for axis in &axes {
            check(machine.name(*axis), machine.soft_limits[*axis], &wanted)?;
        }
        let mut slot = self.slot();
        if slot.as_ref().is_some_and(|hold| !hold.is_over()) {
            return Err(refused(StatusCode::CONFLICT, "found a button that is held already, or not over yet"));
        }
        let hold = Hold::begin(press.hold, prefix, axes, wanted, stamp);
        *slot = Some(hold.map_err(|failure| failed(failure.to_string()))?);
        Ok(json!({ "stamp": self.stamp(), "phase": "arming" }))
    }

    /// The parts of its gains that an axis may have, as its controller has told them last.
    fn gain_range(&self, name: &str) -> Result<[f64; 2], Refused> {
        let report = self.published.report();
        let figures = report.as_ref().and_then(|report| report.axes().find(|(axis, _)| *axis == name));
        figures.map(|(_, figures)| figures.gain_range).ok_or_else(|| unusable(format!("axis: found {name:?}, unknown")))
    }

    fn beat(&self, beat: &Beat) -> Answer {
        let stamp = self.time_of(beat.stamp)?;
        let Some(hold) = self.held(beat.hold) else {
            return Err(refused(StatusCode::CONFLICT, "found a button that is not held"));
        };
        let command = beat.command.unwrap_or_default();
        let no_number = || unusable("target: found no number; allowed: a set point in m");
        let is_number = beat.target.is_none_or(f64::is_finite);
        if let Err(refused) = expect_small(command).and_then(|()| is_number.then_some(()).ok_or_else(no_number)) {
            hold.release();
            return Err(refused);
        }
        let (phase, told) = hold.beat(stamp, beat.target, command);
        let (phase, why) = match phase {
            Phase::Arming => ("arming", String::new()),
            Phase::Held => ("held", String::new()),
            Phase::Ended(why) => ("ended", why),
        };
        Ok(json!({ "stamp": self.stamp(), "phase": phase, "why": why, "told": told }))
    }
}

/// Refuses a command that a person who sees the machine on a page only may not give.
fn expect_small(command: f64) -> Result<(), Refused> {
    let allowed = format!("-{LARGEST_COMMAND} to {LARGEST_COMMAND}");
    let refused = || unusable(format!("command: found {command}; allowed: {allowed}"));
    if command.abs() <= LARGEST_COMMAND { Ok(()) } else { Err(refused()) }
}

/// Refuses a place that no teeth can be at, a speed that is too high for a person who sees the machine on a page only,
/// and other axes than the four that move the teeth.
fn place_of(Teeth { x, z, pitch, speed }: Teeth, mode: AxisMode, axes: &[usize]) -> Result<TeethPlace, Refused> {
    if mode != AxisMode::Track || axes != ALL {
        return Err(unusable("teeth: found other axes, or another mode; allowed: all four axes in the mode track"));
    }
    let within = |value: &f64| TipTask::PLACES.contains(value);
    if !within(&x) || !within(&z) {
        let (low, high) = TipTask::PLACES.into_inner();
        return Err(unusable(format!("teeth: found [{x:?}, {z:?}] m; allowed: {low} to {high} m")));
    }
    if let Some(pitch) = pitch.filter(|pitch| !PITCHES.contains(pitch)) {
        return Err(unusable(format!("teeth: found a pitch of {pitch:?} degrees; allowed: -360 to 360")));
    }
    let slowest = *TipTask::SPEEDS.start();
    if !(slowest..=FASTEST_TEETH).contains(&speed) {
        return Err(unusable(format!("teeth: found {speed:?} m/s; allowed: {slowest} to {FASTEST_TEETH} m/s")));
    }
    Ok(TeethPlace { to: [x, z], pitch, speed })
}

/// Refuses a set point or a command outside its range.
fn check(name: &str, [low, high]: [f64; 2], wanted: &Wanted) -> Result<(), Refused> {
    if let Some(target) = wanted.target.filter(|target| !(low..=high).contains(target)) {
        return Err(unusable(format!("target: found {target} m; allowed: axis.{name} within {low} to {high} m")));
    }
    expect_small(wanted.command)
}

fn refused(status: StatusCode, why: impl Into<String>) -> Refused {
    (status, why.into())
}

fn unusable(why: impl Into<String>) -> Refused {
    refused(StatusCode::UNPROCESSABLE_ENTITY, why)
}

fn failed(error: impl ToString) -> Refused {
    refused(StatusCode::CONFLICT, error.to_string())
}

fn parsed<'a, T: Deserialize<'a>>(body: &'a Bytes) -> Result<T, Refused> {
    serde_json::from_slice(body).map_err(|error| refused(StatusCode::BAD_REQUEST, error.to_string()))
}

/// JSON, on a connection that stays open where the request had the token.
fn answer(answer: Answer) -> Response {
    let kind = (header::CONTENT_TYPE, "application/json");
    match answer {
        Ok(value) => (Extension(StaysOpen), [kind], format!("{value}\n")).into_response(),
        Err((status, why)) => (status, [kind], format!("{}\n", json!({ "why": why }))).into_response(),
    }
}

/// Marks an answer after which the connection stays open.
#[derive(Debug, Clone, Copy)]
pub struct StaysOpen;

/// The routes.
pub fn routes(control: &Arc<Control>) -> Router {
    let with = |act: fn(&Control, &HeaderMap, &Bytes) -> Answer| {
        let control = Arc::clone(control);
        post(move |headers: HeaderMap, body: Bytes| async move { answer(act(&control, &headers, &body)) })
    };
    let (stopping, resetting, scaling) = (Arc::clone(control), Arc::clone(control), Arc::clone(control));
    Router::new()
        .route(
            "/control/hello",
            with(|control, headers, _| {
                control.admit(headers, None)?;
                Ok(json!({ "stamp": control.stamp() }))
            }),
        )
        .route(
            "/control/press",
            with(|control, headers, body| {
                control.admit(headers, None)?;
                control.press(&parsed(body)?)
            }),
        )
        .route(
            "/control/beat",
            with(|control, headers, body| {
                let beat: Beat = parsed(body)?;
                control.admit(headers, Some(beat.hold))?;
                control.beat(&beat)
            }),
        )
        .route(
            "/control/release",
            with(|control, headers, body| {
                let release: Release = parsed(body)?;
                control.admit(headers, Some(release.hold))?;
                if let Some(hold) = control.held(release.hold) {
                    hold.release();
                }
                Ok(json!({ "stamp": control.stamp() }))
            }),
        )
        .route("/control/reset", post(move |headers: HeaderMap, body: Bytes| reset(resetting, headers, body)))
        .route("/control/gain", post(move |headers: HeaderMap, body: Bytes| scale(scaling, headers, body)))
        .route("/control/off", post(move || off(stopping)))
}

/// Stops all axes. The stop is on the board before anything is waited for.
async fn off(control: Arc<Control>) -> Response {
    let asked = control.group().and_then(|prefix| {
        let board = board(&prefix).map_err(failed)?;
        let ticket = board.stop(0..board.machine().axis_count as usize);
        Ok((board, ticket))
    });
    if let Some(hold) = control.slot().as_ref() {
        hold.release();
    }
    let (board, ticket) = match asked {
        Ok(asked) => asked,
        Err(refused) => return answer(Err(refused)),
    };
    let until = Instant::now() + PATIENCE;
    while !board.is_done(&ticket) {
        if Instant::now() > until {
            return answer(Err(failed(
                "asked to stop, not answered: the controller does not run or hangs, and then drives go neutral by \
                 themselves. Cut the pressure off by hand if anything moves",
            )));
        }
        tokio::time::sleep(LOOK).await;
    }
    answer(Ok(json!({ "phase": "off" })))
}

/// Releases latched axes. It waits for the controller, so it has a thread.
async fn reset(control: Arc<Control>, headers: HeaderMap, body: Bytes) -> Response {
    let asked = control.admit(&headers, None).and_then(|()| Ok((control.group()?, parsed::<Reset>(&body)?)));
    let (prefix, reset) = match asked {
        Ok(asked) => asked,
        Err(refused) => return answer(Err(refused)),
    };
    operate(move || {
        let released = release(&prefix, &reset.axes);
        let _ = remove_leftovers(&prefix);
        released
    })
    .await
}

/// Changes the gains of the fallback of an axis. It waits for the controller, so it has a thread.
async fn scale(control: Arc<Control>, headers: HeaderMap, body: Bytes) -> Response {
    let asked = control.admit(&headers, None).and_then(|()| {
        let gain = parsed::<Gain>(&body)?;
        Ok((control.group()?, control.gain_range(&gain.axis)?, gain))
    });
    let (prefix, range, Gain { axis, gain }) = match asked {
        Ok(asked) => asked,
        Err(refused) => return answer(Err(refused)),
    };
    if !(range[0]..=range[1]).contains(&gain) {
        let [least, largest] = range;
        return answer(Err(unusable(format!("gain: found {gain}; allowed: {least:.3} to {largest:.3}"))));
    }
    operate(move || {
        let scaled = Operator::join(&prefix, false, Arc::new(AtomicBool::new(false))).map_err(Failure::from).and_then(
            |mut operator| {
                let place = axes_of(operator.machine().names(), &[axis]).map_err(Failure::usage)?[0];
                Ok(json!({ "gain": gain, "before": operator.scale(place, gain, range)? }))
            },
        );
        let _ = remove_leftovers(&prefix);
        scaled
    })
    .await
}

/// Does on a thread what waits for the controller.
async fn operate(act: impl FnOnce() -> Result<Value, Failure> + Send + 'static) -> Response {
    let done = tokio::task::spawn_blocking(move || act().map_err(|failure| failed(failure.to_string())));
    answer(done.await.unwrap_or_else(|error| Err(failed(error))))
}

fn release(prefix: &Prefix, names: &[String]) -> Result<Value, Failure> {
    let mut operator = Operator::join(prefix, false, Arc::new(AtomicBool::new(false)))?;
    let mut axes = axes_of(operator.machine().names(), names).map_err(Failure::usage)?;
    axes.retain(|axis| !operator.latched_by(*axis).is_empty());
    let causes: Vec<String> =
        axes.iter().map(|axis| format!("{}: {}", operator.machine().name(*axis), operator.latched_by(*axis))).collect();
    operator.release(&axes).map_err(|error: OperatorError| Failure::from(error))?;
    Ok(json!({ "released": causes }))
}
