use nalgebra::Matrix4;

/// The filter's model of how people move: position is the integral of a velocity that decays and is driven by white
/// noise (an integrated Ornstein-Uhlenbeck process),
///
/// ```text
/// dx = v dt,   dv = −v/τ dt + √q dW,   q = 2σ²/τ,   in x and in y alike.
/// ```
///
/// The velocity has variance σ² at all times, so expected speeds stay realistic and an unseen person slows down instead
/// of running away. For times well below τ this is the constant-velocity model with white acceleration of density q.
/// Steps are exact for any length of time, so two short steps equal one long step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Motion {
    /// σ, the standard deviation of the velocity along each axis, in m/s.
    pub speed_m_s: f64,
    /// τ, the correlation time of the velocity, in seconds.
    pub memory_s: f64,
}

impl Motion {
    /// People indoors: an RMS speed of 1 m/s over both axes, with a stop or turn about every other second.
    pub const WALKING: Motion = Motion { speed_m_s: 0.7, memory_s: 1.5 };

    /// F and Q over `seconds` (0 or more): the state (x, y, vx, vy) becomes F state + noise of covariance Q.
    pub fn over(&self, seconds: f64) -> (Matrix4<f64>, Matrix4<f64>) {
        let rate = 1.0 / self.memory_s;
        // 1 − e^{−t/τ} and 1 − e^{−2t/τ}, without cancellation at small times.
        let lost = -(-rate * seconds).exp_m1();
        let lost_twice = -(-2.0 * rate * seconds).exp_m1();
        let density = 2.0 * self.speed_m_s.powi(2) * rate;
        let carried = lost / rate;
        let vv = density * lost_twice / (2.0 * rate);
        let xv = density * carried * carried / 2.0;
        let xx = density / (rate * rate) * (seconds - 2.0 * carried + lost_twice / (2.0 * rate));
        let kept = 1.0 - lost;
        #[rustfmt::skip]
        let transition = Matrix4::new(
            1.0, 0.0, carried, 0.0,
            0.0, 1.0, 0.0, carried,
            0.0, 0.0, kept, 0.0,
            0.0, 0.0, 0.0, kept,
        );
        #[rustfmt::skip]
        let noise = Matrix4::new(
            xx, 0.0, xv, 0.0,
            0.0, xx, 0.0, xv,
            xv, 0.0, vv, 0.0,
            0.0, xv, 0.0, vv,
        );
        (transition, noise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_the_integral_of_the_differential_equation() {
        // dP/dt = A P + P Aᵀ + G and dF/dt = A F, integrated in small steps by the midpoint rule.
        let motion = Motion { speed_m_s: 0.8, memory_s: 1.3 };
        let mut a = Matrix4::zeros();
        let mut g = Matrix4::zeros();
        for axis in 0..2 {
            a[(axis, axis + 2)] = 1.0;
            a[(axis + 2, axis + 2)] = -1.0 / motion.memory_s;
            g[(axis + 2, axis + 2)] = 2.0 * motion.speed_m_s.powi(2) / motion.memory_s;
        }
        let (mut f, mut q) = (Matrix4::identity(), Matrix4::zeros());
        let (span, steps) = (0.9, 20_000);
        let h = span / steps as f64;
        let slope = |q: &Matrix4<f64>| a * q + q * a.transpose() + g;
        for _ in 0..steps {
            f += h * a * (f + 0.5 * h * a * f);
            q += h * slope(&(q + 0.5 * h * slope(&q)));
        }
        let (transition, noise) = motion.over(span);
        assert!((f - transition).amax() < 1e-8, "{f}{transition}");
        assert!((q - noise).amax() < 1e-8, "{q}{noise}");
    }

    #[test]
    fn it_is_the_constant_velocity_model_while_nothing_is_forgotten() {
        // τ and σ grow together, so that q stays constant.
        let (density, t) = (0.6_f64, 0.4_f64);
        let memory_s = 1e6;
        let motion = Motion { speed_m_s: (density * memory_s / 2.0).sqrt(), memory_s };
        let (f, q) = motion.over(t);
        assert!((f[(0, 2)] - t).abs() < 1e-6 && (f[(2, 2)] - 1.0).abs() < 1e-6);
        assert!((q[(2, 2)] - density * t).abs() < 1e-6);
        assert!((q[(1, 3)] - density * t * t / 2.0).abs() < 1e-6);
        // A smaller τ here, because cancellation leaves fewer digits in Q_xx.
        assert!(
            (Motion { memory_s: 1e3, speed_m_s: (density * 500.0_f64).sqrt() }.over(t).1[(0, 0)]
                - density * t.powi(3) / 3.0)
                .abs()
                < 1e-4
        );
    }

    #[test]
    fn two_short_steps_are_a_long_one_and_the_velocity_keeps_its_variance() {
        let motion = Motion::WALKING;
        let ((f1, q1), (f2, q2), (f, q)) = (motion.over(0.13), motion.over(0.4), motion.over(0.53));
        assert!((f2 * f1 - f).amax() < 1e-14);
        assert!((f2 * q1 * f2.transpose() + q2 - q).amax() < 1e-14);
        let kept = f[(2, 2)].powi(2) * motion.speed_m_s.powi(2) + q[(2, 2)];
        assert!((kept - motion.speed_m_s.powi(2)).abs() < 1e-14);
        assert_eq!(motion.over(0.0), (Matrix4::identity(), Matrix4::zeros()));
    }
}
