/* GRBL 1.1h in virtual time. The host (stdin/stdout) says how many seconds pass; nothing runs between. */
#define _GNU_SOURCE
#include <ucontext.h>
#include <unistd.h>
#include <stdio.h>
#include "src/grbl.h"
#undef main
volatile io_sim_t io={{0}};

void sei(void){io.sreg|=SEI;} void cli(void){io.sreg&=~SEI;}
char pgm_read_byte_near(const char*s){return *s;}
int avr_main(void);
void interrupt_CONTROL_INT_vect(void);
#define HZ 16000000ull
#define BYTE 1389ull /* 115200 baud */
#define QUANTUM 640ull
static ucontext_t host, fw; static char stack[1<<20];
static uint64_t now, until, next_step, next_tx, next_rx; static int stepping, sending;
static uint8_t rx[1<<16]; static uint32_t rx_n, rx_i;
static uint8_t tx[1<<20]; static uint32_t tx_n;
static int32_t phys[3], *way; static uint32_t way_n, way_cap;
static int32_t sw[3]={1<<30,1<<30,1<<30}, contact=-(1<<30); static uint8_t forced, buttons;
static uint8_t eeprom[1024]; static const char*eeprom_name;
static uint64_t period(void){static const int s[8]={0,1,8,64,256,1024,1,1};return ((uint64_t)OCR1A+1)*s[TCCR1B&7];}
static void pins(void){
  static uint8_t was=0; uint8_t hit=forced;
  for(int a=0;a<3;a++) if(phys[a]>=sw[a]) hit|=1<<a;
  uint8_t p=0xff; if(hit&1)p&=~(1<<X_LIMIT_BIT); if(hit&2)p&=~(1<<Y_LIMIT_BIT); if(hit&4)p&=~(1<<Z_LIMIT_BIT);
  PINB=p; uint8_t c=0xff; if(buttons&1)c&=~(1<<CONTROL_FEED_HOLD_BIT); if(buttons&2)c&=~(1<<CONTROL_CYCLE_START_BIT);
  if(phys[2]<=contact)c&=~(1<<PROBE_BIT); 
  static uint8_t cwas=0xff; PINC=c;
  if(hit!=was && (PCICR&(1<<LIMIT_INT)) && (LIMIT_PCMSK&LIMIT_MASK)) {was=hit; interrupt_LIMIT_INT_vect();} was=hit;
  if(c!=cwas && (PCICR&(1<<CONTROL_INT))) {cwas=c; interrupt_CONTROL_INT_vect();} cwas=c;
}
static void do_step(void){
  interrupt_TIMER1_COMPA_vect();
  uint8_t s=PORTD; int any=0;
  for(int a=0;a<3;a++) if(s&(1<<(X_STEP_BIT+a))) {phys[a]+= (s&(1<<(X_DIRECTION_BIT+a)))?-1:1; any=1;}
  interrupt_TIMER0_OVF_vect();
  if(any){ if(way_n+3>way_cap){way_cap=way_cap?2*way_cap:1<<16; way=realloc(way,4*way_cap);} memcpy(way+way_n,phys,12); way_n+=3; pins(); }
}
static void pass(uint64_t dt){
  uint64_t end=now+dt;
  for(;;){
    int on=(TIMSK1>>OCIE1A)&1; if(on&&!stepping) next_step=now+period(); stepping=on;
    int tr=(UCSR0B>>UDRIE0)&1; if(tr&&!sending) next_tx=now+BYTE; sending=tr;
    uint64_t t=end;
    if(on&&next_step<t)t=next_step; if(tr&&next_tx<t)t=next_tx; if(rx_i<rx_n&&next_rx<t)t=next_rx>now?next_rx:now;
    if(t>until){ now=until; swapcontext(&fw,&host); pins(); continue; }
    now=t;
    if(on&&next_step<=now){ do_step(); next_step=now+period(); }
    if(tr&&next_tx<=now){ interrupt_SERIAL_UDRE(); if(tx_n<sizeof tx) tx[tx_n++]=UDR0; next_tx=now+BYTE; }
    if(rx_i<rx_n&&next_rx<=now){ UDR0=rx[rx_i++]; interrupt_SERIAL_RX(); next_rx=now+BYTE; }
    if(now>=end) return;
  }
}
void sim_poll(void){pass(QUANTUM);}
void _delay_ms(int ms){pass(ms*(HZ/1000));}
void _delay_us(int us){pass(us*(HZ/1000000));}
unsigned char eeprom_get_char(unsigned int a){return eeprom[a&1023];}
void eeprom_put_char(unsigned int a,unsigned char v){ if(eeprom[a&1023]==v) return; eeprom[a&1023]=v; pass(HZ*33/10000);
  FILE*f=fopen(eeprom_name,"wb"); if(f){fwrite(eeprom,1,1024,f);fclose(f);} }
static void begin(void){avr_main();}
static int all(int fd,void*b,size_t n){char*p=b;while(n){ssize_t k=read(fd,p,n);if(k<=0)return 0;p+=k;n-=k;}return 1;}
static void put(const void*b,size_t n){const char*p=b;while(n){ssize_t k=write(1,p,n);if(k<=0)_exit(1);p+=k;n-=k;}}
#pragma pack(push,1)
struct ask{double seconds;int32_t sw[3],contact;uint8_t forced,buttons;uint32_t n;};
struct tell{int32_t phys[3];uint8_t pwm_on,ocr,motors_off,state;uint32_t tx_n,way_n;double now;};
#pragma pack(pop)
int main(int argc,char**argv){
  eeprom_name=argv[1]; memset(eeprom,0xff,sizeof eeprom); FILE*f=fopen(eeprom_name,"rb"); if(f){size_t k=fread(eeprom,1,1024,f);(void)k;fclose(f);}
  for(int a=0;a<3&&argc>2+a;a++) phys[a]=atoi(argv[2+a]);
  PINB=PINC=0xff; getcontext(&fw); fw.uc_stack.ss_sp=stack; fw.uc_stack.ss_size=sizeof stack; fw.uc_link=0; makecontext(&fw,begin,0);
  struct ask q; double owed=0;
  while(all(0,&q,sizeof q)){
    memcpy(sw,q.sw,sizeof sw); contact=q.contact; forced=q.forced; buttons=q.buttons;
    if(rx_i==rx_n) {rx_i=rx_n=0; if(next_rx<now) next_rx=now+BYTE;} else if(rx_i){memmove(rx,rx+rx_i,rx_n-rx_i);rx_n-=rx_i;rx_i=0;}
    if(rx_n+q.n>sizeof rx) _exit(3);
    if(!all(0,rx+rx_n,q.n)) break; rx_n+=q.n;

    owed+=q.seconds*HZ; uint64_t k=owed; owed-=k; until+=k; tx_n=way_n=0;
    swapcontext(&host,&fw);
    struct tell r={{phys[0],phys[1],phys[2]},(TCCR2A>>COM2A1)&1,OCR2A,(PORTB&1)!=0,sys.state,tx_n,way_n,(double)now/HZ};
    put(&r,sizeof r); put(tx,tx_n); put(way,4*way_n);
  }
  return 0;
}
