//! The machine seen from the side, as lines of an SVG.

use std::fmt::Write as _;

use mechanism::Vector;

use super::side::Drawn;

/// Colours of bodies, cylinders and ground.
const BODY: &str = "#303030";
const CYLINDER: &str = "#56a0d0";
pub const GROUND: &str = "#8c6e46";

/// How places of the machine become places of a picture.
pub struct View {
    /// Where the centre of swing is on the ground.
    pub origin: (f64, f64),
    /// Pixels per metre.
    pub scale: f64,
}

impl View {
    /// A place of the machine on the picture.
    pub fn at(&self, place: Vector) -> (f64, f64) {
        (self.origin.0 + self.scale * place.x, self.origin.1 - self.scale * place.z)
    }

    /// Draws bodies, cylinders and links in one pose.
    pub fn machine(&self, svg: &mut String, drawn: &Drawn, opacity: f64) {
        let faint = format!(" opacity=\"{opacity:.2}\"");
        let mut draw = |points: &mut dyn Iterator<Item = &Vector>, colour: &str, width: f64| {
            let points: Vec<_> = points.map(|place| self.at(*place)).collect();
            line(svg, &points, colour, width, &faint);
        };
        for body in &drawn.bodies {
            draw(&mut body.iter().chain(body.first()), BODY, 2.0);
        }
        for cylinder in &drawn.cylinders {
            draw(&mut cylinder.iter(), CYLINDER, 4.0);
        }
        draw(&mut drawn.links.iter(), BODY, 2.0);
    }
}

/// Adds a line through points of the picture; `more` has further attributes.
pub fn line(svg: &mut String, points: &[(f64, f64)], colour: &str, width: f64, more: &str) {
    let _ = writeln!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\"{more}/>",
        listed(points)
    );
}

/// Points as an attribute.
pub fn listed(points: &[(f64, f64)]) -> String {
    points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
}
