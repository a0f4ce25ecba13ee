//! Up to four axes over time: their valves and cylinders side by side, one axis in each lane.
//!
//! One step is begun with the commands, takes the rates of change at four stages, and ends. Between two stages the
//! caller computes the pump's share from the demand of all axes.
//!
//! Only [`FourAxes::new`] allocates.

use mechanism::AXES;
use pipeline::machine::{Axis, Hydraulics, LoadForce, Plant};

use crate::{
    actuator::{
        cylinder::{Cylinder, State},
        edges::Edges,
    },
    conditions::{Conditions, Work},
    coupling::Coupling,
    hydraulics::{oil::LOWEST_PRESSURE, supply::Demand},
    lanes::{LANES, Lanes, lanes},
    valve::{DelayLine, Valve},
};

/// Parameters of one axis from the machine file.
#[derive(Debug, Clone)]
struct AxisModel {
    plant: Plant,
    /// L, m.
    stroke: f64,
    /// Number of the axis in the machine.
    index: usize,
}

/// True state of one axis, without the encoder's noise and resolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueState {
    /// y, m; 0 with the rod fully retracted.
    pub position: f64,
    /// v, m/s; positive while the rod extends.
    pub velocity: f64,
    /// p1, Pa above the atmosphere.
    pub piston_pressure: f64,
    /// p2, Pa above the atmosphere.
    pub rod_pressure: f64,
    /// x_v in [-1, 1]; positive extends the rod.
    pub spool_position: f64,
    /// q1, flow through the valve into the piston side, m3/s.
    pub piston_flow: f64,
    /// q2, flow out of the rod side through the valve, m3/s.
    pub rod_flow: f64,
    /// s q_f, flow that the axis gets from the pump, m3/s.
    pub pump_flow: f64,
}

/// Up to four axes: their parameters at this time, their state, and the step that is being made.
#[derive(Debug, Clone)]
pub struct FourAxes {
    /// A lane without an axis repeats the first axis. Its command stays zero, so it stays at rest without flow.
    models: [AxisModel; LANES],
    /// Number of axes, 1 to 4.
    axes: usize,
    conditions: [Conditions; LANES],
    valve: Valve<Lanes>,
    cylinder: Cylinder<Lanes>,
    /// What moves the pistons as one, where these axes are those of a mechanism; otherwise each has its own mass.
    coupling: Option<Coupling>,
    delays: [DelayLine; LANES],
    /// w: positions that the spools approach.
    target: Lanes,
    /// x_v.
    spool: Lanes,
    /// X at the begin, in the middle and at the end of the step.
    openings: [Lanes; 3],
    state: State<Lanes>,
    /// State of the present stage of the step, at which the rates are taken.
    stage: State<Lanes>,
    /// Weighted sum of the rates of the stages so far.
    sum: State<Lanes>,
    /// Flows through the control edges at the present stage.
    edges: Edges,
}

impl FourAxes {
    /// The axes at rest: at their initial positions, valves shut, loads held by the oil.
    ///
    /// `axes` are 1 to 4 axes, the first of which has the number `first` in the machine. The pump idles at `idle` Pa.
    /// `of` returns the conditions of the axis with a number. Dead times are rounded to whole steps of `step` s.
    pub fn new(
        axes: &[(&Axis, &Plant)],
        first: usize,
        hydraulics: &Hydraulics,
        idle: f64,
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
            let (piston, rod) = cylinders[lane].pressures_at_rest(cylinders[lane].load.at(position), idle);
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
            coupling: None,
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

    /// Couples the axes at rest by a linkage, which takes the place of their masses and loads. The oil holds its
    /// weight, and the pump idles at `idle` Pa.
    pub fn couple(&mut self, coupling: Coupling, hydraulics: &Hydraulics, idle: f64) {
        for model in &mut self.models {
            (model.plant.load_force, model.plant.load_stiffness) = (LoadForce::constant(0.0), 0.0);
        }
        let cylinders = cylinders(&self.models, hydraulics, &self.conditions);
        let positions: [f64; AXES] = self.state[0].to_array();
        let weights = coupling.holding_forces(&positions);
        let at_rest: [(f64, f64); AXES] = std::array::from_fn(|lane| {
            let external = cylinders[lane].load.at(positions[lane]);
            cylinders[lane].pressures_at_rest(weights[lane] + external, idle)
        });
        self.state[2] = lanes(&at_rest, |rest| rest.0);
        self.state[3] = lanes(&at_rest, |rest| rest.1);
        self.cylinder = Cylinder::pack(&cylinders);
        self.coupling = Some(coupling);
    }

    /// The linkage, where these axes are those of a mechanism.
    pub fn coupling(&self) -> Option<&Coupling> {
        self.coupling.as_ref()
    }

    /// Changes what the bucket of a mechanism works on.
    pub fn work(&mut self, work: Work) {
        if let Some(coupling) = &mut self.coupling {
            coupling.work(work.payload, work.soil);
        }
    }

    /// Parameters of the cylinders now.
    pub fn cylinder(&self) -> &Cylinder<Lanes> {
        &self.cylinder
    }

    /// y, v, p1, p2 and z of the axes at the end of the last step.
    pub fn state(&self) -> &State<Lanes> {
        &self.state
    }

    /// Changes the parameters to other conditions; `of` returns the conditions of the axis with a number.
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

    /// Begins a step under `commands`, one in [-1, 1] for each axis. While the pilot pressure is `cut_off`, springs
    /// centre the spools, whatever is commanded now or was commanded within the dead time.
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

    /// What the axes ask of the pump at this stage, when its pressure is `supply` Pa; `part` is 0 at the begin of the
    /// step, 1 in the middle, 2 at the end.
    #[inline]
    pub fn demand(&mut self, part: usize, supply: f64) -> Demand {
        self.edges = self.cylinder.edges(&self.stage, self.openings[part], supply);
        self.edges.total_demand()
    }

    /// Adds the rates of this stage to the sum with `weight`, and moves to the next stage, `ahead` s after the begin of
    /// the step. Every axis gets the part `share` of its demand.
    #[inline]
    pub fn take_rates(&mut self, share: f64, weight: f64, ahead: f64) {
        let mut rates = self.cylinder.rates(&self.stage, &self.edges, Lanes::splat(share));
        rates[1] = match &self.coupling {
            None => rates[1] * self.cylinder.inverse_mass,
            Some(coupling) => coupling.accelerations(self.stage[0], self.stage[1], rates[1]),
        };
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
        // This bound acts only where the step is too long for a chamber.
        let lowest = Lanes::splat(LOWEST_PRESSURE);
        self.state[2] = self.state[2].fast_max(lowest);
        self.state[3] = self.state[3].fast_max(lowest);
    }

    /// What the axes ask of the pump at the end of the last step, when its pressure is `supply` Pa.
    pub fn demand_now(&self, supply: f64) -> Demand {
        self.cylinder.edges(&self.state, self.openings[2], supply).total_demand()
    }

    /// The true state of each axis when the pump's pressure is `supply` Pa and every axis gets the part `share` of its
    /// demand, and the pressure in the chamber that the pump feeds, Pa; negative infinity where it feeds none.
    pub fn observe(&self, share: f64, supply: f64) -> impl Iterator<Item = (TrueState, f64)> {
        let edges = self.cylinder.edges(&self.state, self.openings[2], supply);
        let (q1, q2) = edges.flows(Lanes::splat(share));
        let [y, v, p1, p2, _] = self.state.map(Lanes::to_array);
        let (q1, q2, spool) = (q1.to_array(), q2.to_array(), self.spool.to_array());
        let (fed, pump) = (edges.delivered_to().to_array(), edges.from_pump(Lanes::splat(share)).to_array());
        (0..self.axes).map(move |lane| {
            let state = TrueState {
                position: y[lane],
                velocity: v[lane],
                piston_pressure: p1[lane],
                rod_pressure: p2[lane],
                spool_position: spool[lane],
                piston_flow: q1[lane],
                rod_flow: q2[lane],
                pump_flow: pump[lane],
            };
            (state, fed[lane])
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
