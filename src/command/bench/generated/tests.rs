use std::collections::BTreeSet;

use super::{class::Class, record::Record};

#[test]
fn both_halves_have_every_class() {
    for half in [0, 1] {
        let classes: BTreeSet<Class> = (0..34).filter(|number| number % 2 == half).map(Class::of).collect();
        assert_eq!(classes.len(), Class::ALL.len());
    }
}

#[test]
fn a_record_depends_on_seed_and_number_alone_and_has_motion() {
    for number in 0..34 {
        let record = Record::draw(3, number);
        let spread = |values: &[f64]| {
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            values.iter().map(|value| (value - mean).abs()).fold(0.0, f64::max)
        };
        assert!(record.outputs.iter().all(|y| y.is_finite()) && record.inputs.len() == record.outputs.len());
        // In the training and after it.
        let training = record.outputs.len() * 2 / 5;
        for part in [&record.outputs[..training], &record.outputs[training..]] {
            assert!(spread(part) > 0.01, "{number}: {}", spread(part));
        }
        assert!(record.inputs.iter().any(|u| *u > 0.0) && record.horizon > 0, "{number}");
        let wild = record.without_wild.as_ref().map(|clean| clean != &record.outputs);
        let expected = matches!(record.class, Class::Dropouts | Class::Spikes).then_some(true);
        assert_eq!(wild, expected, "{number}");
    }
    assert_eq!(Record::draw(3, 8).outputs, Record::draw(3, 8).outputs);
    assert_ne!(Record::draw(3, 8).outputs, Record::draw(4, 8).outputs);
}

#[test]
fn a_plant_is_the_same_at_every_period() {
    let [fast, slow] = [0.001, 0.02].map(|period| Record::at_period(1, 1_000_000, period));
    assert_eq!(slow.delay, 1 + (fast.delay - 1) / 20);
    assert_eq!((fast.horizon, slow.horizon), (500, 25));
}
