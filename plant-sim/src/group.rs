//! Up to four axes through time: valves and cylinders side by side.

use pipeline::machine::{Axis, Hydraulics, Plant};

use crate::{
    conditions::Conditions,
    cylinder::{Cylinder, Edges, State},
    lanes::{LANES, Lanes, lanes},
    oil::LOWEST_PRESSURE,
    valve::{DelayLine, Valve},
};

/// What an axis is made of, as the machine file has it.
#[derive(Debug, Clone)]
struct AxisModel {
    /// Its parameters.
    plant: Plant,
    /// L, m.
    stroke: f64,
    /// Its place in the machine.
    index: usize,
}

/// What an observer of one axis sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisState {
    /// y, m, 0 with the rod in.
    pub position: f64,
    /// v, m/s, positive extends.
    pub velocity: f64,
    /// p1, Pa above the atmosphere.
    pub piston_pressure: f64,
    /// p2, Pa above the atmosphere.
    pub rod_pressure: f64,
    /// x_v in [-1, 1], positive extends.
    pub spool_position: f64,
    /// q1 through the valve into the piston side, m3/s.
    pub piston_flow: f64,
    /// q2 out of the rod side through the valve, m3/s.
    pub rod_flow: f64,
}

/// Up to four axes: their parameters at this time, their state, and the step in work.
#[derive(Debug, Clone)]
pub struct Group {
    /// A lane that no axis has repeats the first one, at rest and without flow.
    models: [AxisModel; LANES],
    axes: usize,
    conditions: [Conditions; LANES],
    valve: Valve<Lanes>,
    cylinder: Cylinder<Lanes>,
    delays: [DelayLine; LANES],
    /// What the spools are asked for.
    target: Lanes,
    spool: Lanes,
    /// Openings at begin, middle and end of the step.
    openings: [Lanes; 3],
    state: State<Lanes>,
    /// State at which the rates are taken, and the weighted sum of the rates so far.
    stage: State<Lanes>,
    sum: State<Lanes>,
    edges: Edges,
}

impl Group {
    /// The axes at rest: at their initial positions, valves shut, loads held. There are 1 to 4, numbered from `first`;
    /// `of` gives the conditions of an axis of the machine; dead times are rounded to whole steps of `step` s.
    pub fn new(
        axes: &[(&Axis, &Plant)],
        first: usize,
        hydraulics: &Hydraulics,
        of: impl Fn(usize) -> Conditions,
        step: f64,
    ) -> Self {
        let models: [AxisModel; LANES] = std::array::from_fn(|lane| {
            let index = if lane < axes.len() { lane } else { 0 };
            let (axis, plant) = axes[index];
            AxisModel { plant: plant.clone(), stroke: axis.stroke, index: first + index }
        });
        let conditions = std::array::from_fn(|lane| of(models[lane].index));
        let cylinders = cylinders(&models, hydraulics, &conditions);
        let at_rest: [[f64; 3]; LANES] = std::array::from_fn(|lane| {
            let position = models[lane].plant.initial_position;
            let (piston, rod) = cylinders[lane].pressures_at_rest(position);
            [position, piston, rod]
        });
        let state = [
            lanes(&at_rest, |rest| rest[0]),
            Lanes::ZERO,
            lanes(&at_rest, |rest| rest[1]),
            lanes(&at_rest, |rest| rest[2]),
            Lanes::ZERO,
        ];
        Self {
            axes: axes.len(),
            valve: valve(&models, &conditions, step),
            cylinder: Cylinder::pack(&cylinders),
            delays: std::array::from_fn(|lane| DelayLine::new((models[lane].plant.dead_time / step).round() as usize)),
            models,
            conditions,
            target: Lanes::ZERO,
            spool: Lanes::ZERO,
            openings: [Lanes::ZERO; 3],
            state,
            stage: state,
            sum: [Lanes::ZERO; 5],
            edges: Edges::default(),
        }
    }

    /// The conditions of the first axis.
    pub fn first_conditions(&self) -> Conditions {
        self.conditions[0]
    }

    /// Takes the parameters to other conditions; `of` gives those of an axis of the machine.
    pub fn apply(&mut self, of: impl Fn(usize) -> Conditions, hydraulics: &Hydraulics, step: f64) {
        let conditions = std::array::from_fn(|lane| of(self.models[lane].index));
        if conditions == self.conditions {
            return;
        }
        self.conditions = conditions;
        self.cylinder = Cylinder::pack(&cylinders(&self.models, hydraulics, &conditions));
        self.valve = valve(&self.models, &conditions, step);
        self.openings[2] = self.valve.opening(self.spool);
    }

    /// Begins a step under `commands`, one per axis in [-1, 1]. With the pilot pressure `cut_off` the springs centre the
    /// spools, whatever is commanded or under way.
    #[inline]
    pub fn begin(&mut self, commands: &[f64], cut_off: bool) {
        let mut acting = [0.0; LANES];
        for ((acting, delay), command) in acting.iter_mut().zip(&mut self.delays).zip(commands) {
            *acting = delay.pass(*command);
        }
        self.target = if cut_off { Lanes::ZERO } else { self.valve.target(self.target, Lanes::new(acting)) };
        let (middle, end) = self.valve.spool_after(self.spool, self.target);
        self.openings = [self.openings[2], self.valve.opening(middle), self.valve.opening(end)];
        self.spool = end;
        self.stage = self.state;
        self.sum = [Lanes::ZERO; 5];
    }

    /// What the axes ask of the pump at this stage, m3/s; `part` of the step is 0 at its begin, 1 in the middle, 2 at
    /// its end.
    #[inline]
    pub fn demand(&mut self, part: usize) -> f64 {
        self.edges = self.cylinder.edges(&self.stage, self.openings[part]);
        crate::supply::demand(&self.edges)
    }

    /// Takes the rates of this stage into the sum with `weight`, and moves on by `ahead` s from the step's begin.
    #[inline]
    pub fn take_rates(&mut self, share: f64, weight: f64, ahead: f64) {
        let rates = self.cylinder.rates(&self.stage, &self.edges, Lanes::splat(share));
        let (weight, ahead) = (Lanes::splat(weight), Lanes::splat(ahead));
        for (i, rate) in rates.into_iter().enumerate() {
            self.sum[i] += weight * rate;
            self.stage[i] = self.state[i] + ahead * rate;
        }
    }

    /// Ends a step of `step` s.
    #[inline]
    pub fn end(&mut self, step: f64) {
        for (value, sum) in self.state.iter_mut().zip(self.sum) {
            *value += Lanes::splat(step) * sum;
        }
        // Only a step that is too long for its chamber gets there.
        let lowest = Lanes::splat(LOWEST_PRESSURE);
        self.state[2] = self.state[2].fast_max(lowest);
        self.state[3] = self.state[3].fast_max(lowest);
    }

    /// What the axes ask of the pump now, m3/s.
    pub fn demand_now(&self) -> f64 {
        crate::supply::demand(&self.cylinder.edges(&self.state, self.openings[2]))
    }

    /// What an observer sees, axis by axis, with the pump's `share`; and the pressures in the chambers that are fed.
    pub fn observe(&self, share: f64) -> impl Iterator<Item = (AxisState, Option<f64>)> {
        let edges = self.cylinder.edges(&self.state, self.openings[2]);
        let (q1, q2) = self.cylinder.flows(&edges, Lanes::splat(share));
        let [y, v, p1, p2, _] = self.state.map(Lanes::to_array);
        let (q1, q2, spool) = (q1.to_array(), q2.to_array(), self.spool.to_array());
        let demand = edges.demand.to_array();
        (0..self.axes).map(move |lane| {
            let state = AxisState {
                position: y[lane],
                velocity: v[lane],
                piston_pressure: p1[lane],
                rod_pressure: p2[lane],
                spool_position: spool[lane],
                piston_flow: q1[lane],
                rod_flow: q2[lane],
            };
            let fed = if q1[lane] > 0.0 { p1[lane] } else { p2[lane] };
            (state, (demand[lane] > 0.0).then_some(fed))
        })
    }
}

fn cylinders(
    models: &[AxisModel; LANES],
    hydraulics: &Hydraulics,
    conditions: &[Conditions; LANES],
) -> [Cylinder<f64>; LANES] {
    std::array::from_fn(|lane| {
        let AxisModel { plant, stroke, .. } = &models[lane];
        Cylinder::new(plant, *stroke, hydraulics, &conditions[lane])
    })
}

fn valve(models: &[AxisModel; LANES], conditions: &[Conditions; LANES], step: f64) -> Valve<Lanes> {
    Valve::pack(&std::array::from_fn(|lane| Valve::new(&models[lane].plant, &conditions[lane], step)))
}
