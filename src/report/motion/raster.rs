//! A picture as pixels, in the format PNG.
//!
//! Everything is drawn [`FINE`] times as large, without half-tones, and every square of pixels becomes one pixel with
//! the mean of their colours. So edges are smooth.

use std::error::Error;

use plotters::{
    coord::Shift,
    prelude::{
        BitMapBackend, DrawingArea, DrawingBackend, FontDesc, IntoDrawingArea, RGBAColor, ShapeStyle, TextStyle,
    },
};
use plotters_backend::{BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingErrorKind};

/// Pixels that are drawn for one pixel of the picture, along both edges.
const FINE: u32 = 2;
/// Bytes of a pixel: red, green, blue.
const BYTES: usize = 3;

/// The picture of a size, as `draw` draws it.
///
/// # Errors
/// The library cannot draw or encode it.
pub fn png(
    (width, height): (u32, u32),
    draw: impl FnOnce(&DrawingArea<Fine<'_>, Shift>) -> Result<(), Box<dyn Error + Send + Sync>>,
) -> Result<Vec<u8>, Box<dyn Error + Send + Sync>> {
    let mut fine = vec![0; (width * FINE * height * FINE) as usize * BYTES];
    let backend = BitMapBackend::with_buffer(&mut fine, (width * FINE, height * FINE));
    draw(&Fine { backend }.into_drawing_area())?;
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&means(&fine, (width * FINE) as usize))?;
    writer.finish()?;
    Ok(file)
}

/// The means of squares of pixels, [`FINE`] along each edge, of an image of this width.
fn means(fine: &[u8], width: usize) -> Vec<u8> {
    let edge = FINE as usize;
    let rows = fine.chunks_exact(width * BYTES * edge);
    let of_rows = |rows: &[u8]| {
        let mean = |i: usize| {
            let (pixel, colour) = (i / BYTES, i % BYTES);
            let at = |row: usize, column: usize| rows[(row * width + pixel * edge + column) * BYTES + colour];
            let sum: u32 = (0..edge * edge).map(|k| u32::from(at(k / edge, k % edge))).sum();
            (sum / (FINE * FINE)) as u8
        };
        (0..width / edge * BYTES).map(mean).collect::<Vec<u8>>()
    };
    rows.flat_map(of_rows).collect()
}

/// Draws on a bitmap that is [`FINE`] times as large as the size that it says it has.
pub struct Fine<'a> {
    backend: BitMapBackend<'a>,
}

type Drawn<'a> = Result<(), DrawingErrorKind<<BitMapBackend<'a> as DrawingBackend>::ErrorType>>;

/// A coordinate on the larger bitmap.
fn fine((x, y): BackendCoord) -> BackendCoord {
    (x * FINE as i32, y * FINE as i32)
}

/// A style with wider strokes.
fn wider(style: &impl BackendStyle) -> ShapeStyle {
    let BackendColor { alpha, rgb: (r, g, b) } = style.color();
    ShapeStyle { color: RGBAColor(r, g, b, alpha), filled: true, stroke_width: style.stroke_width() * FINE }
}

impl<'a> DrawingBackend for Fine<'a> {
    type ErrorType = <BitMapBackend<'a> as DrawingBackend>::ErrorType;

    fn get_size(&self) -> (u32, u32) {
        let (width, height) = self.backend.get_size();
        (width / FINE, height / FINE)
    }

    fn ensure_prepared(&mut self) -> Drawn<'a> {
        self.backend.ensure_prepared()
    }

    fn present(&mut self) -> Drawn<'a> {
        self.backend.present()
    }

    fn draw_pixel(&mut self, point: BackendCoord, color: BackendColor) -> Drawn<'a> {
        let (x, y) = fine(point);
        self.backend.draw_rect((x, y), (x + FINE as i32 - 1, y + FINE as i32 - 1), &color, true)
    }

    fn draw_line<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S) -> Drawn<'a> {
        self.backend.draw_line(fine(from), fine(to), &wider(style))
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        upper_left: BackendCoord,
        bottom_right: BackendCoord,
        style: &S,
        fill: bool,
    ) -> Drawn<'a> {
        self.backend.draw_rect(fine(upper_left), fine(bottom_right), &wider(style), fill)
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(&mut self, path: I, style: &S) -> Drawn<'a> {
        self.backend.draw_path(path.into_iter().map(fine), &wider(style))
    }

    fn draw_circle<S: BackendStyle>(&mut self, center: BackendCoord, radius: u32, style: &S, fill: bool) -> Drawn<'a> {
        self.backend.draw_circle(fine(center), radius * FINE, &wider(style), fill)
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(&mut self, vert: I, style: &S) -> Drawn<'a> {
        self.backend.fill_polygon(vert.into_iter().map(fine), &wider(style))
    }

    fn draw_text<T: BackendTextStyle>(&mut self, text: &str, style: &T, pos: BackendCoord) -> Drawn<'a> {
        let font = FontDesc::new(style.family(), style.size() * f64::from(FINE), style.style());
        let font = font.transform(style.transform());
        let larger = TextStyle { font, color: style.color(), pos: style.anchor() };
        self.backend.draw_text(text, &larger, fine(pos))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_is_the_mean_of_the_pixels_that_were_drawn_for_it() {
        let fine = [[0, 0, 0], [100, 0, 0], [8, 8, 8], [8, 8, 8], [100, 40, 0], [200, 0, 0], [8, 8, 8], [8, 8, 8]];
        assert_eq!(means(&fine.concat(), 4), [100, 10, 0, 8, 8, 8]);
    }
}
